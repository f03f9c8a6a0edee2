//! Figures: false-color maps of the outgoing sphere, energy budgets, grids of numbers and curves, laid out
//! here, written as SVG and rasterized by libraries.

pub mod axes;
pub mod budget;
pub mod cloth;
pub mod color;
pub mod figure;
pub mod grid;
pub mod lines;
pub mod map;
pub mod page;
pub mod path;
pub mod pattern;
pub mod sheet;
pub mod text;

use crate::failure::{Failure, Outcome};
use figure::Figure;
use std::path::Path;

/// File format of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Pixels.
    Png,
    /// The document.
    Svg,
}

impl Format {
    /// The format for the ending of an output file.
    pub fn from_path(path: &Path) -> Outcome<Format> {
        match path.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
            Some("png") => Ok(Format::Png),
            Some("svg") => Ok(Format::Svg),
            other => {
                let ending = other.map_or("no ending".into(), |e| format!(".{e}"));
                Err(Failure::input(
                    path.display(),
                    "-o",
                    ending,
                    "figures are written as .png or .svg; name the file so",
                ))
            }
        }
    }

    /// Name of the format, which is its ending.
    pub fn name(self) -> &'static str {
        match self {
            Format::Png => "png",
            Format::Svg => "svg",
        }
    }

    /// A figure as the bytes of a file; `path` is for messages.
    pub fn encode(self, figure: &Figure, path: &Path) -> Outcome<Vec<u8>> {
        match self {
            Format::Png => png(&figure.raster(), path),
            Format::Svg => Ok(figure.svg().into_bytes()),
        }
    }
}

/// A picture as the bytes of a PNG file; `path` is for messages.
pub fn png(image: &image::RgbImage, path: &Path) -> Outcome<Vec<u8>> {
    let mut bytes = Vec::new();
    image
        .write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png)
        .map_err(|e| Failure::input(path.display(), "-o", e, "choose a place that can be written"))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_says_the_format() {
        let of = |name: &str| Format::from_path(Path::new(name)).ok();
        assert_eq!(of("a.png").zip(of("b.c.SVG")), Some((Format::Png, Format::Svg)));
        assert!(["a.jpg", "a", "png", ".svg", "a.png.gz"].into_iter().all(|name| of(name).is_none()));
    }
}

//! Figures: false-colour maps of the outgoing sphere, energy budgets and grids of numbers, drawn with no outside help.

pub mod axes;
pub mod budget;
pub mod canvas;
pub mod colormap;
mod font;
pub mod grid;
pub mod lines;
pub mod map;
pub mod pattern;
pub mod sheet;
pub mod weave;

use crate::failure::{Failure, Outcome};
use std::path::Path;

/// Figures one below the other.
pub fn below(figures: &[image::RgbImage]) -> image::RgbImage {
    let width = figures.iter().map(image::RgbImage::width).max().unwrap_or(1);
    let height = figures.iter().map(image::RgbImage::height).sum::<u32>().max(1);
    let mut all = image::RgbImage::from_pixel(width, height, image::Rgb(canvas::WHITE));
    let mut y = 0;
    for figure in figures {
        image::imageops::replace(&mut all, figure, 0, i64::from(y));
        y += figure.height();
    }
    all
}

/// A figure as the bytes of a PNG file; `path` is for messages.
pub fn png(image: &image::RgbImage, path: &Path) -> Outcome<Vec<u8>> {
    let mut bytes = Vec::new();
    image
        .write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png)
        .map_err(|e| Failure::input(path.display(), "-o", e, "choose a place that can be written"))?;
    Ok(bytes)
}

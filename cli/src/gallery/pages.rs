//! What the gallery writes: the pictures composed of their panels, small ones of them, and the pages that list them.

use super::pictures::Panel;
use crate::failure::{Failure, Outcome};
use crate::plot::figure::{Align, CAP, Figure, INK};
use crate::plot::text::literal;
use image::RgbImage;
use image::imageops::{FilterType, replace, resize};
use plywave::fabric::GapLight;
use plywave_render::Setup;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Pixels between panels.
const BETWEEN: u32 = 6;
/// Room for a line of text below panels.
const BELOW: u32 = 28;
/// Most bytes of a small picture.
const SMALL_BYTES: usize = 140_000;
/// Sides of a small picture's panels, the largest that fits counts. Titles of ten letters still fit the last.
const SMALL_SIDES: [u32; 8] = [256, 224, 192, 176, 160, 144, 128, 112];

/// What a panel was rendered with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shot {
    /// Below it.
    pub title: String,
    /// Fabric spec, relative to the gallery's folder.
    pub fabric: String,
    /// Of the fabric spec and of its models.
    pub digest: String,
    /// Scene.
    pub setup: String,
    /// Width of the cloth [mm].
    pub size_mm: f32,
    /// Pixels a side.
    pub pixels: u32,
    /// Samples a pixel.
    pub samples: u32,
    /// Most scatterings.
    pub depth: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Stops by which it is brighter.
    pub exposure: f32,
    /// Light through gaps goes straight on.
    pub straight_gaps: bool,
    /// Without speckle.
    pub smooth: bool,
    /// One absorption for all yarns [1/um].
    pub sigma_per_um: Option<f32>,
}

impl Shot {
    /// Of a panel.
    pub fn of(panel: &Panel, fabric: String, digest: String, pixels: u32, samples: u32, depth: u32) -> Shot {
        Shot {
            title: panel.title.clone(),
            fabric,
            digest,
            setup: name_of(panel.setup).into(),
            size_mm: panel.size_mm,
            pixels,
            samples: samples * panel.samples,
            depth,
            seed: 1,
            exposure: panel.exposure,
            straight_gaps: panel.options.gaps == GapLight::Straight,
            smooth: !panel.options.noise,
            sigma_per_um: panel.options.sigma_per_um,
        }
    }

    /// The command that renders it alone, in the gallery's folder.
    fn command(&self, output: &str) -> String {
        let Shot { fabric, setup, size_mm, pixels, samples, depth, .. } = self;
        let mut words = format!(
            "plywave render {fabric} --setup {setup} --size-mm {size_mm} --width {pixels} --height {pixels} --samples {samples} --depth {depth}"
        );
        if let Some(sigma) = self.sigma_per_um {
            words += &format!(" --sigma {sigma}");
        }
        if self.straight_gaps {
            words += " --straight-gaps";
        }
        if self.smooth {
            words += " --smooth";
        }
        if self.exposure != 0.0 {
            words += &format!(" --exposure {}", self.exposure);
        }
        format!("{words} -o {output}")
    }
}

/// Name of a setup on the command line.
fn name_of(setup: Setup) -> &'static str {
    match setup {
        Setup::Front => "front",
        Setup::Back => "back",
        Setup::Drape => "drape",
        Setup::Folds => "folds",
        Setup::Swatch => "swatch",
        Setup::Furnace => "furnace",
    }
}

/// A picture of the index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// What is to be seen.
    pub caption: String,
    /// PNG, relative to the folder.
    pub file: String,
    /// Small PNG.
    pub small: String,
    /// From left to right.
    pub panels: Vec<Shot>,
    /// Time it took [s].
    pub seconds: f64,
}

/// The index, `gallery.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Index {
    /// Program that wrote it.
    pub program_version: String,
    /// Whether it was made with `--quick`.
    pub quick: bool,
    /// In order.
    pub pictures: Vec<Entry>,
}

/// Panels side by side, their titles below.
pub fn strip(panels: &[RgbImage], titles: &[&str]) -> RgbImage {
    let [panel] = panels else {
        let height = panels.iter().map(RgbImage::height).max().unwrap_or(1);
        let width = panels.iter().map(|p| p.width() + BETWEEN).sum::<u32>().max(BETWEEN + 1) - BETWEEN;
        let mut figure = Figure::new(width as i32, (height + BELOW) as i32);
        let mut x = 0;
        for (panel, title) in panels.iter().zip(titles) {
            let (middle, y) = ((x + panel.width() / 2) as i32, height as i32 + (BELOW as i32 - CAP) / 2);
            figure.text_within(middle, y, panel.width() as i32, &literal(title, 80), Align::Center, INK);
            x += panel.width() + BETWEEN;
        }
        let mut image = figure.raster();
        let mut x = 0;
        for panel in panels {
            replace(&mut image, panel, i64::from(x), 0);
            x += panel.width() + BETWEEN;
        }
        return image;
    };
    panel.clone()
}

/// A picture small enough for a page, as PNG: fewer pixels, and colors in steps of 4 of 255, which noise hides.
pub fn small(panels: &[RgbImage], titles: &[&str], about: &[(String, String)], path: &Path) -> Outcome<Vec<u8>> {
    let mut last = Vec::new();
    for side in SMALL_SIDES {
        let of = |p: &RgbImage| {
            let mut image = match p.width() > side {
                true => resize(p, side, side, FilterType::Triangle),
                false => p.clone(),
            };
            image.iter_mut().for_each(|v| *v = ((u16::from(*v) + 2).min(255) & !3) as u8);
            image
        };
        let image = strip(&panels.iter().map(of).collect::<Vec<_>>(), titles);
        last = png(&image, about, path)?;
        if last.len() <= SMALL_BYTES {
            break;
        }
    }
    Ok(last)
}

/// A PNG with what it is of as text: the program, the caption and the command of each panel.
pub fn png(image: &RgbImage, about: &[(String, String)], path: &Path) -> Outcome<Vec<u8>> {
    plywave_render::png(image, about).map_err(|e| Failure::input(path.display(), "-o", e, "choose another place"))
}

/// What a picture of the gallery is of, for its file: names and values.
pub fn about(entry: &Entry) -> Vec<(String, String)> {
    let mut list = vec![
        ("Software".to_string(), format!("plywave {}", env!("CARGO_PKG_VERSION"))),
        ("Title".to_string(), entry.name.clone()),
        ("Description".to_string(), entry.caption.clone()),
    ];
    for (k, shot) in entry.panels.iter().enumerate() {
        let file = format!("{}_{}.png", entry.name, k + 1);
        list.push((format!("panel {} command", k + 1), shot.command(&file)));
        list.push((format!("panel {} digest", k + 1), shot.digest.clone()));
    }
    list
}

/// The page for README: the small pictures with what is to be seen, and the commands of each panel.
pub fn markdown(index: &Index, command: &str) -> String {
    let mut page = format!("Made by `{command}`.\n");
    for entry in &index.pictures {
        page += &format!("\n![{}]({})\n\n{}\n\n```sh\n", entry.name, entry.small, entry.caption);
        for (k, shot) in entry.panels.iter().enumerate() {
            let output = match entry.panels.len() {
                1 => entry.file.clone(),
                _ => format!("{}_{}.png", entry.name, k + 1),
            };
            page += &format!("{}\n", shot.command(&output));
        }
        page += "```\n";
    }
    page
}

//! What the gallery writes: the pictures composed of their panels, compressed for pages, and the pages that list them.

use super::pictures::Panel;
use crate::failure::{Failure, Outcome};
use crate::plot::figure::{Align, CAP, Figure, INK};
use crate::plot::text::literal;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::replace;
use plywave::fabric::GapLight;
use plywave_render::Setup;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Pixels between panels.
const BETWEEN: u32 = 6;
/// Room for a line of text below panels.
const BELOW: u32 = 28;
/// Most bytes of a picture for a page, and the qualities that are tried.
const PAGE_BYTES: usize = 300_000;
const PAGE_QUALITIES: [u8; 5] = [92, 88, 82, 74, 64];

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
    /// Parts that are left out.
    pub without: Vec<String>,
    /// One absorption for all yarns [1/um].
    pub sigma_per_um: Option<f32>,
    /// Width of slits between fibers [um], and share of the forward light that goes through them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slits: Option<[f32; 2]>,
}

impl Shot {
    /// Of a panel.
    pub fn new(panel: &Panel, fabric: String, digest: String, pixels: u32, samples: u32, depth: u32) -> Shot {
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
            without: [
                (panel.options.layers, "layers"),
                (panel.options.shadowing, "shadowing"),
                (panel.options.edges, "edges"),
            ]
            .into_iter()
            .filter(|(is_in, _)| !is_in)
            .map(|(_, name)| name.to_string())
            .collect(),
            sigma_per_um: panel.options.sigma_per_um,
            slits: panel.options.slits.map(|slits| [slits.width_um, slits.share]),
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
        if let Some([width_um, share]) = self.slits {
            words += &format!(" --slit-um {width_um} --slit-share {share}");
        }
        if !self.without.is_empty() {
            words += &format!(" --without {}", self.without.join(","));
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
        Setup::Grazing => "grazing",
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
    /// JPEG for a page.
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

/// A picture for a page: JPEG of all its pixels, at the best quality that fits into [`PAGE_BYTES`].
pub fn for_page(panels: &[RgbImage], titles: &[&str], path: &Path) -> Outcome<Vec<u8>> {
    let image = strip(panels, titles);
    let mut last = Vec::new();
    for quality in PAGE_QUALITIES {
        last.clear();
        let encoder = JpegEncoder::new_with_quality(&mut last, quality);
        image
            .write_with_encoder(encoder)
            .map_err(|e| Failure::input(path.display(), "-o", e, "choose another place"))?;
        if last.len() <= PAGE_BYTES {
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

/// The page: the pictures with what is to be seen, and the commands of each panel.
pub fn markdown(index: &Index, command: &str) -> String {
    let mut page = format!("GeneratedStrands by `{command}`.\n");
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

//! The film: sums over the samples of each pixel, and their file, from which a render resumes. `picture.rs`
//! writes the film as EXR and PNG.

use crate::RenderError;
use crate::memory_limit::check_memory;
use crate::roulette::CutSums;
use plywave::color;
use std::collections::HashMap;
use std::path::Path;

/// Bytes per pixel of a film's sums.
const PIXEL_BYTES: u64 = 4 * 14;
/// Largest number of bytes per pixel that a render needs beside its sums: one pass of samples, or the
/// pictures while they are written.
const WORK_BYTES: u64 = 120;

/// Sums over the samples of each pixel, `[y][x]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    width: u32,
    height: u32,
    /// Part of the tiles that the film has, and the number of parts: tile k belongs to part k modulo that
    /// number.
    part: [u32; 2],
    samples: u32,
    /// XYZ of the light.
    light: Vec<[f32; 3]>,
    /// XYZ of the albedo of the first hit under the illuminant.
    albedo: Vec<[f32; 3]>,
    /// Sums of the first hits' normals, in the scene's axes, on the camera's side.
    normal: Vec<[f32; 3]>,
    /// Sums of the depths of the first hits [mm].
    depth: Vec<f32>,
    /// Samples that hit the sheet first.
    hits: Vec<f32>,
    /// Sums of squared deviations of the samples' linear sRGB from their mean.
    deviation: Vec<[f32; 3]>,
    /// Sums that estimate the light omitted by cuts.
    cut: CutSums,
}

/// Quantity that a picture of a film shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilmView {
    /// The light.
    Light,
    /// The albedo of the first hit.
    Albedo,
}

/// One sample of a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// XYZ of the light.
    pub light: [f32; 3],
    /// XYZ of the albedo of the first hit.
    pub albedo: [f32; 3],
    /// Normal and depth of the first hit.
    pub hit: Option<([f32; 3], f32)>,
    /// Sums that estimate the light omitted by cuts.
    pub cut: CutSums,
}

/// Sums over some samples of one pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PixelSums {
    light: [f32; 3],
    albedo: [f32; 3],
    normal: [f32; 3],
    depth: f32,
    hits: f32,
    /// Sum and sum of squares of linear sRGB.
    rgb: [[f64; 3]; 2],
    cut: CutSums,
}

impl PixelSums {
    pub fn add(&mut self, sample: &Sample) {
        let rgb = color::linear_srgb_of_xyz(sample.light.map(f64::from));
        for k in 0..3 {
            self.light[k] += sample.light[k];
            self.albedo[k] += sample.albedo[k];
            self.rgb[0][k] += rgb[k];
            self.rgb[1][k] += rgb[k] * rgb[k];
        }
        if let Some((normal, depth)) = sample.hit {
            (0..3).for_each(|k| self.normal[k] += normal[k]);
            self.depth += depth;
            self.hits += 1.0;
        }
        self.cut.add(&sample.cut);
    }
}

/// Inputs of a render, by name: a render resumes only if all of them are unchanged.
pub type Ingredients = [(String, String)];

/// Names of the sums in the file, and the number of values per pixel.
const TENSORS: [(&str, usize); 6] =
    [("light", 3), ("albedo", 3), ("normal", 3), ("depth", 1), ("hits", 1), ("deviation", 3)];
/// Prefix of the ingredients in the file.
const INGREDIENT: &str = "of ";
/// Name of the sums of cut paths in the file.
const CUT: &str = "cut";
/// Largest header of a file of sums [bytes].
const MAX_HEADER: u64 = 1 << 20;

impl Film {
    /// A black film.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the film and its pictures do not fit in memory.
    pub fn new(width: u32, height: u32) -> Result<Film, RenderError> {
        let pixels = u64::from(width) * u64::from(height);
        let what = format!("a film of {width} x {height} pixels");
        check_memory(&what, pixels.saturating_mul(PIXEL_BYTES + WORK_BYTES))?;
        let n = pixels as usize;
        Ok(Film {
            width,
            height,
            part: [0, 1],
            samples: 0,
            light: vec![[0.0; 3]; n],
            albedo: vec![[0.0; 3]; n],
            normal: vec![[0.0; 3]; n],
            depth: vec![0.0; n],
            hits: vec![0.0; n],
            deviation: vec![[0.0; 3]; n],
            cut: CutSums::default(),
        })
    }

    /// A film for one of `parts` parts of a picture, which separate processes can render: it has every
    /// `parts`-th tile, and its other pixels stay black. The sum of all parts equals the whole picture bit
    /// for bit.
    ///
    /// # Errors
    /// As [`Film::new`].
    pub fn new_part(width: u32, height: u32, part: u32, parts: u32) -> Result<Film, RenderError> {
        let parts = parts.max(1);
        Ok(Film { part: [part % parts, parts], ..Film::new(width, height)? })
    }

    /// Clears the film: black, without samples, for the same part.
    pub fn clear(&mut self) {
        for plane in [&mut self.light, &mut self.albedo, &mut self.normal, &mut self.deviation] {
            plane.fill([0.0; 3]);
        }
        self.depth.fill(0.0);
        self.hits.fill(0.0);
        (self.samples, self.cut) = (0, CutSums::default());
    }

    /// Whether a tile belongs to the film's part.
    pub(crate) fn has_tile(&self, tile: u32) -> bool {
        tile % self.part[1] == self.part[0]
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Samples per pixel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Adds the sums of `count` samples of a pixel. [`Film::count`] follows once all pixels have them.
    pub(crate) fn add(&mut self, x: u32, y: u32, sums: &PixelSums, count: u32) {
        let at = self.at(x, y);
        let (before, n) = (f64::from(self.samples), f64::from(count.max(1)));
        // The squared deviations of two joined sets of samples are the sum of their own and of those of their
        // means (Chan, Golub and LeVeque 1979).
        let mean = color::linear_srgb_of_xyz(self.light[at].map(|v| f64::from(v) / before.max(1.0)));
        for k in 0..3 {
            let own = sums.rgb[0][k] / n;
            let within = (sums.rgb[1][k] - n * own * own).max(0.0);
            let between = (own - mean[k]).powi(2) * before * n / (before + n);
            self.deviation[at][k] += (within + between) as f32;
            self.light[at][k] += sums.light[k];
            self.albedo[at][k] += sums.albedo[k];
            self.normal[at][k] += sums.normal[k];
        }
        self.depth[at] += sums.depth;
        self.hits[at] += sums.hits;
        self.cut.add(&sums.cut);
    }

    pub(crate) fn count(&mut self, samples: u32) {
        self.samples += samples;
    }

    fn at(&self, x: u32, y: u32) -> usize {
        y as usize * self.width as usize + x as usize
    }

    /// Mean XYZ of a pixel; the white of the illuminant has Y = 1.
    pub fn xyz(&self, view: FilmView, x: u32, y: u32) -> [f32; 3] {
        let at = self.at(x, y);
        let sums = match view {
            FilmView::Light => &self.light,
            FilmView::Albedo => &self.albedo,
        };
        sums[at].map(|v| v / self.samples.max(1) as f32)
    }

    /// Linear sRGB of a pixel.
    pub fn linear(&self, view: FilmView, x: u32, y: u32) -> [f32; 3] {
        color::linear_srgb_of_xyz(self.xyz(view, x, y).map(f64::from)).map(|v| v as f32)
    }

    /// Unit mean normal of the first hits, in the scene's axes, on the camera's side; 0 if no sample hits an
    /// object.
    pub fn normal(&self, x: u32, y: u32) -> [f32; 3] {
        let n = self.normal[self.at(x, y)];
        let length = n.iter().map(|v| v * v).sum::<f32>().sqrt();
        if length > 0.0 { n.map(|v| v / length) } else { n }
    }

    /// Mean depth of the first hits along the camera's axis [mm]; 0 if no sample hits an object.
    pub fn depth(&self, x: u32, y: u32) -> f32 {
        let at = self.at(x, y);
        self.depth[at] / self.hits[at].max(1.0)
    }

    /// Variance of a pixel's linear sRGB over its samples, divided by their number; `None` for fewer than two
    /// samples. For explicit fibers this is the variance of the mean; for other scenes it is an upper bound,
    /// because the random numbers of a pixel's paths are stratified.
    pub fn variance(&self, x: u32, y: u32) -> Option<[f32; 3]> {
        let n = self.samples as f32;
        (self.samples > 1).then(|| self.deviation[self.at(x, y)].map(|d| d / (n * (n - 1.0))))
    }

    /// Fraction of the light of visible objects that cuts at the largest number of scatterings omit, 0 to 1,
    /// as estimated by cut paths that continue without adding to the picture.
    pub fn cut_share(&self) -> f64 {
        self.cut.share()
    }

    /// Bytes of a file with the film's sums, for [`Film::resume`].
    ///
    /// # Errors
    /// [`RenderError::Picture`] if they cannot be encoded.
    pub fn sums(&self, of: &Ingredients) -> Result<Vec<u8>, RenderError> {
        let bad = |e: safetensors::SafeTensorError| RenderError::Picture { file: "sums".into(), what: e.to_string() };
        let triples = |v: &[[f32; 3]]| v.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let singles = |v: &[f32]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let data = [
            triples(&self.light),
            triples(&self.albedo),
            triples(&self.normal),
            singles(&self.depth),
            singles(&self.hits),
            triples(&self.deviation),
        ];
        let mut about: HashMap<String, String> =
            of.iter().map(|(name, value)| (format!("{INGREDIENT}{name}"), value.clone())).collect();
        about.insert("samples".into(), self.samples.to_string());
        about.insert(CUT.into(), self.cut.to_text());
        let mut views = Vec::new();
        for ((name, channels), data) in TENSORS.into_iter().zip(&data) {
            let shape = vec![self.height as usize, self.width as usize, channels];
            views
                .push((name, safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape, data).map_err(bad)?));
        }
        safetensors::serialize(views, Some(about)).map_err(bad)
    }

    /// Loads the sums of [`Film::sums`] for a film of this size.
    ///
    /// # Errors
    /// [`RenderError::Picture`] if the file is damaged or an input differs from `of` (the message names the
    /// input); [`RenderError::Io`]; those of [`Film::new`].
    pub fn resume(path: &Path, of: &Ingredients, width: u32, height: u32) -> Result<Film, RenderError> {
        let file = path.display().to_string();
        let bad = |what: &str| RenderError::Picture {
            file: file.clone(),
            what: format!("{what}; start over with --fresh instead of --resume"),
        };
        let mut film = Film::new(width, height)?;
        let max = u64::from(width) * u64::from(height) * PIXEL_BYTES + MAX_HEADER;
        let bytes = crate::memory_limit::read_file(path, max)?;
        let damaged = |_| bad("not the sums of a render");
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).map_err(damaged)?;
        let about = metadata.metadata().clone().unwrap_or_default();
        for (name, value) in of {
            if about.get(&format!("{INGREDIENT}{name}")) != Some(value) {
                return Err(bad(&format!("sums of another render: not the same {name}")));
            }
        }
        if about.keys().filter(|k| k.starts_with(INGREDIENT)).count() != of.len() {
            return Err(bad("sums of another render: of more inputs"));
        }
        let samples: Option<u32> = about.get("samples").and_then(|s| s.parse().ok());
        film.samples = samples.filter(|n| *n > 0).ok_or_else(|| bad("damaged: no count of samples"))?;
        let cut = about.get(CUT).and_then(|text| CutSums::from_text(text));
        film.cut = cut.ok_or_else(|| bad("damaged: no sums of what cuts leave out"))?;
        let tensors = safetensors::SafeTensors::deserialize(&bytes).map_err(damaged)?;
        let mut sums = TENSORS.map(|_| Vec::new());
        for ((name, channels), out) in TENSORS.into_iter().zip(&mut sums) {
            let t = tensors.tensor(name).map_err(damaged)?;
            if *t.shape() != [height as usize, width as usize, channels] || t.dtype() != safetensors::Dtype::F32 {
                return Err(bad("damaged: sums of another size"));
            }
            *out = t.data().as_chunks().0.iter().map(|c| f32::from_le_bytes(*c)).collect();
            if out.iter().any(|v: &f32| !v.is_finite()) {
                return Err(bad("damaged: a sum that is not finite"));
            }
        }
        let [light, albedo, normal, depth, hits, deviation] = sums;
        let triples = |v: Vec<f32>| v.as_chunks().0.to_vec();
        Ok(Film {
            light: triples(light),
            albedo: triples(albedo),
            normal: triples(normal),
            depth,
            hits,
            deviation: triples(deviation),
            ..film
        })
    }

    /// The picture in sRGB, times 2^`exposure`.
    pub fn image(&self, view: FilmView, exposure: f32) -> image::RgbImage {
        image::RgbImage::from_fn(self.width, self.height, |x, y| {
            let linear = self.linear(view, x, y).map(|v| v * exposure.exp2());
            image::Rgb(linear.map(|v| (255.0 * color::srgb_encode(f64::from(v.clamp(0.0, 1.0)))).round() as u8))
        })
    }
}

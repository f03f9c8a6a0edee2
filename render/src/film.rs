//! The picture: sums of XYZ a pixel, kept whole on disk so that a render can go on, and written as EXR and PNG.

use crate::RenderError;
use crate::path::LAMBDA_RANGE_UM;
use plywave::color;
use std::collections::HashMap;
use std::path::Path;

/// Sums over the samples of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    width: u32,
    height: u32,
    samples: u32,
    /// XYZ of the light, `[y][x]`.
    light: Vec<[f32; 3]>,
    /// XYZ of the albedo first seen, lit by the illuminant.
    albedo: Vec<[f32; 3]>,
}

/// Which picture of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilmView {
    /// The light.
    Light,
    /// The albedo.
    Albedo,
}

impl Film {
    /// A black film.
    pub fn new(width: u32, height: u32) -> Film {
        let pixels = width as usize * height as usize;
        Film { width, height, samples: 0, light: vec![[0.0; 3]; pixels], albedo: vec![[0.0; 3]; pixels] }
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Samples a pixel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    pub(crate) fn add(&mut self, x: u32, y: u32, light: [f32; 3], albedo: [f32; 3]) {
        let at = y as usize * self.width as usize + x as usize;
        for k in 0..3 {
            self.light[at][k] += light[k];
            self.albedo[at][k] += albedo[k];
        }
    }

    pub(crate) fn count(&mut self, samples: u32) {
        self.samples += samples;
    }

    /// Mean XYZ of a pixel; 1 for Y is the white of the illuminant.
    pub fn xyz(&self, view: FilmView, x: u32, y: u32) -> [f32; 3] {
        let at = y as usize * self.width as usize + x as usize;
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

    /// Writes the sums, so that [`Film::resume`] can go on. `key` names what is rendered.
    ///
    /// # Errors
    /// [`RenderError::Io`].
    pub fn save(&self, path: &Path, key: &str) -> Result<(), RenderError> {
        let file = path.display().to_string();
        let bytes = |values: &[[f32; 3]]| values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let (light, albedo) = (bytes(&self.light), bytes(&self.albedo));
        let shape = vec![self.height as usize, self.width as usize, 3];
        let view = |data| {
            safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), data)
                .map_err(|e| RenderError::Picture { file: file.clone(), what: e.to_string() })
        };
        let about = HashMap::from([("key".into(), key.into()), ("samples".into(), self.samples.to_string())]);
        let data = safetensors::serialize([("light", view(&light)?), ("albedo", view(&albedo)?)], Some(about))
            .map_err(|e| RenderError::Picture { file: file.clone(), what: e.to_string() })?;
        let partial = path.with_extension("partial");
        let io = |source| RenderError::Io { file: file.clone(), source };
        std::fs::write(&partial, data).map_err(io)?;
        std::fs::rename(&partial, path).map_err(io)
    }

    /// Goes on from sums that [`Film::save`] wrote.
    ///
    /// # Errors
    /// [`RenderError::Picture`] when they are of something else than `key`, or damaged; [`RenderError::Io`].
    pub fn resume(path: &Path, key: &str) -> Result<Film, RenderError> {
        let file = path.display().to_string();
        let bad = |what: &str| RenderError::Picture { file: file.clone(), what: what.to_string() };
        let bytes = std::fs::read(path).map_err(|source| RenderError::Io { file: file.clone(), source })?;
        let damaged = |_| bad("not sums of a render; remove it to start anew");
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).map_err(damaged)?;
        let about = metadata.metadata().clone().unwrap_or_default();
        if about.get("key").map(String::as_str) != Some(key) {
            return Err(bad("of another fabric, setup or size; remove it to start anew"));
        }
        let samples =
            about.get("samples").and_then(|s| s.parse().ok()).ok_or_else(|| bad("without its count of samples"))?;
        let tensors = safetensors::SafeTensors::deserialize(&bytes).map_err(damaged)?;
        let mut sums = Vec::new();
        let mut size = [0, 0];
        for name in ["light", "albedo"] {
            let t = tensors.tensor(name).map_err(damaged)?;
            let [height, width, 3] = *t.shape() else { return Err(bad("damaged")) };
            size = [width as u32, height as u32];
            let numbers: Vec<f32> = t.data().as_chunks().0.iter().map(|c| f32::from_le_bytes(*c)).collect();
            sums.push(numbers.as_chunks().0.to_vec());
        }
        let (Some(albedo), Some(light)) = (sums.pop(), sums.pop()) else { return Err(bad("damaged")) };
        if light.len() != albedo.len() || light.len() != size[0] as usize * size[1] as usize {
            return Err(bad("damaged"));
        }
        Ok(Film { width: size[0], height: size[1], samples, light, albedo })
    }

    /// Writes an EXR of linear sRGB with two layers, the light (unnamed) and `albedo`.
    ///
    /// # Errors
    /// [`RenderError::Picture`].
    pub fn write_exr(&self, path: &Path) -> Result<(), RenderError> {
        use exr::prelude::*;
        let size = Vec2(self.width as usize, self.height as usize);
        let of = |view: FilmView| {
            move |at: Vec2<usize>| {
                let [r, g, b] = self.linear(view, at.x() as u32, at.y() as u32);
                (r, g, b)
            }
        };
        let layer = |name: &str| LayerAttributes::named(name);
        let light =
            Layer::new(size, layer("light"), Encoding::SMALL_FAST_LOSSLESS, SpecificChannels::rgb(of(FilmView::Light)));
        let albedo = Layer::new(
            size,
            layer("albedo"),
            Encoding::SMALL_FAST_LOSSLESS,
            SpecificChannels::rgb(of(FilmView::Albedo)),
        );
        Image::empty(ImageAttributes::new(IntegerBounds::from_dimensions(size)))
            .with_layer(light)
            .with_layer(albedo)
            .write()
            .to_file(path)
            .map_err(|e| RenderError::Picture { file: path.display().to_string(), what: e.to_string() })
    }

    /// The picture in sRGB, times 2^`exposure`.
    pub fn image(&self, view: FilmView, exposure: f32) -> image::RgbImage {
        image::RgbImage::from_fn(self.width, self.height, |x, y| {
            let linear = self.linear(view, x, y).map(|v| v * exposure.exp2());
            image::Rgb(linear.map(|v| (255.0 * color::srgb_encode(f64::from(v.clamp(0.0, 1.0)))).round() as u8))
        })
    }
}

/// XYZ of light that has the illuminant's spectrum times `values` at the wavelengths of a path, drawn evenly over the picture's range.
pub(crate) fn xyz<const N: usize>(lambda_um: [f32; N], values: [f32; N]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let scale = (LAMBDA_RANGE_UM[1] - LAMBDA_RANGE_UM[0]) / N.max(1) as f32;
    for k in 0..N {
        let matching = color::d65_xyz_density(f64::from(lambda_um[k]));
        for c in 0..3 {
            sum[c] += scale * values[k] * matching[c] as f32;
        }
    }
    sum
}

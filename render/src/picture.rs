//! Encoding of films as files with metadata: EXR with layers for denoisers, PNG with text.

use crate::sky::primaries::Primaries;
use crate::{Film, FilmView, RenderError};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes,
    SmallVec, Text, Vec2, WritableImage,
};

/// Metadata of a picture, written into its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// Program and version.
    pub software: String,
    /// Name of the cloth.
    pub cloth: String,
    /// File name of the cloth or its spec.
    pub spec: String,
    /// Digest of all input files of the picture, as `sha256:...`.
    pub digest: String,
    /// The scene.
    pub scene: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Samples per pixel.
    pub samples: u32,
    /// Exposure of a PNG [stops].
    pub exposure: f32,
    /// Share of the light that cuts omit ([`Film::cut_share`]).
    pub cut_share: f64,
}

impl Facts {
    /// Names and values of the metadata: the PNG's text chunks, and the EXR's attributes with the prefix
    /// `plywave.`.
    pub fn entries(&self) -> [(&'static str, String); 9] {
        [
            ("Software", self.software.clone()),
            ("cloth", self.cloth.clone()),
            ("spec", self.spec.clone()),
            ("digest", self.digest.clone()),
            ("scene", self.scene.clone()),
            ("seed", self.seed.to_string()),
            ("samples", self.samples.to_string()),
            ("exposure", self.exposure.to_string()),
            ("cut_share", format!("{:.4}", self.cut_share)),
        ]
    }
}

/// An OpenEXR text: Latin-1, with `?` for other characters.
fn text(value: &str) -> Text {
    let plain: String = value.chars().map(|c| if (c as u32) < 256 { c } else { '?' }).collect();
    Text::new_or_panic(&plain)
}

impl Film {
    /// Encodes the film as an OpenEXR file, one part of 32-bit floats: `R G B`, linear sRGB of the light;
    /// `albedo.R G B`; `normal.X Y Z`, unit, in the scene's axes, on the camera's side; `depth.Z` along the
    /// camera's axis [mm]; with two or more samples `variance.R G B` ([`Film::variance`]). Normal and depth
    /// are 0 where a pixel hits no object. The header has `facts` and the chromaticities.
    ///
    /// # Errors
    /// [`RenderError::Picture`].
    pub fn exr(&self, facts: &Facts) -> Result<Vec<u8>, RenderError> {
        let (width, height) = (self.width(), self.height());
        let plane = |of: &dyn Fn(u32, u32) -> f32| -> Vec<f32> {
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| of(x, y)).collect()
        };
        let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
        let mut add = |name: &str, of: &dyn Fn(u32, u32) -> f32| {
            channels.push(AnyChannel::new(text(name), FlatSamples::F32(plane(of))));
        };
        for (k, c) in ["R", "G", "B"].into_iter().enumerate() {
            add(c, &|x, y| self.linear(FilmView::Light, x, y)[k]);
            add(&format!("albedo.{c}"), &|x, y| self.linear(FilmView::Albedo, x, y)[k]);
            if self.samples() > 1 {
                add(&format!("variance.{c}"), &|x, y| self.variance(x, y).map_or(0.0, |v| v[k]));
            }
        }
        for (k, c) in ["X", "Y", "Z"].into_iter().enumerate() {
            add(&format!("normal.{c}"), &|x, y| self.normal(x, y)[k]);
        }
        add("depth.Z", &|x, y| self.depth(x, y));
        let size = Vec2(width as usize, height as usize);
        let mut attributes = LayerAttributes::default();
        for (name, value) in facts.entries() {
            match name {
                "Software" => attributes.software_name = Some(text(&value)),
                _ => {
                    let key = text(&format!("plywave.{name}"));
                    attributes.other.insert(key, AttributeValue::Text(text(&value)));
                }
            }
        }
        let layer = Layer::new(size, attributes, Encoding::SMALL_FAST_LOSSLESS, AnyChannels::sort(channels));
        let mut image = Image::from_layer(layer);
        image.attributes.display_window = IntegerBounds::from_dimensions(size);
        let [red, green, blue, white] = Primaries::SRGB.0.map(|[x, y]| Vec2(x as f32, y as f32));
        image.attributes.chromaticities = Some(exr::meta::attribute::Chromaticities { red, green, blue, white });
        let mut out = std::io::Cursor::new(Vec::new());
        let bad = |e: exr::error::Error| RenderError::Picture { file: "EXR".into(), what: e.to_string() };
        image.write().to_buffered(&mut out).map_err(bad)?;
        Ok(sorted_header(out.into_inner()))
    }
}

/// Sorts the attributes of the header by name, because the library writes them in the random order of a hash
/// map. Lengths do not change, so the offsets stay valid.
fn sorted_header(mut file: Vec<u8>) -> Vec<u8> {
    /// Length of the magic number and version, which precede the first attribute.
    const START: usize = 8;
    let mut list = Vec::new();
    let mut at = START;
    // Layout of an attribute: name, 0, type, 0, length in 4 bytes, value.
    while file.get(at).is_some_and(|b| *b != 0) {
        let after = |from: usize| file.get(from..)?.iter().position(|b| *b == 0).map(|n| from + n + 1);
        let end = after(at).and_then(after).and_then(|from| {
            let size = file.get(from..)?.first_chunk::<4>()?;
            Some(from + 4 + u32::from_le_bytes(*size) as usize).filter(|end| *end <= file.len())
        });
        // A header of unknown layout stays unchanged.
        let Some(end) = end else { return file };
        list.push(file[at..end].to_vec());
        at = end;
    }
    list.sort_unstable();
    file[START..at].copy_from_slice(&list.concat());
    file
}

/// Encodes a PNG in sRGB with `entries` as text chunks (iTXt, UTF-8).
///
/// # Errors
/// [`RenderError::Picture`].
pub fn png(image: &image::RgbImage, entries: &[(impl AsRef<str>, String)]) -> Result<Vec<u8>, RenderError> {
    let mut out = Vec::new();
    let bad = |e: png::EncodingError| RenderError::Picture { file: "PNG".into(), what: e.to_string() };
    let mut encoder = png::Encoder::new(&mut out, image.width(), image.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    for (name, value) in entries {
        encoder.add_itxt_chunk(name.as_ref().to_string(), value.clone()).map_err(bad)?;
    }
    let mut writer = encoder.write_header().map_err(bad)?;
    writer.write_image_data(image.as_raw()).map_err(bad)?;
    writer.finish().map_err(bad)?;
    Ok(out)
}

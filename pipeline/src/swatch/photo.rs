//! Photographs of a swatch: linear RGB from PNG files, blocks of their light, and contrast.

use super::geometry::SwatchGeometry;
use plywave::color::{srgb_decode, srgb_encode};
use plywave::{Error, Result, io};
use std::io::Cursor;
use std::path::Path;

/// Blocks along each side of a picture.
pub const SIDE: usize = 8;
pub const BLOCKS: usize = SIDE * SIDE;
/// Squares [pixels] whose contrast is measured.
pub const SQUARES: [usize; 4] = [1, 2, 4, 8];
/// Least and largest side of a picture [pixels].
const SIDES: [usize; 2] = [64, 8192];
/// Codes at which a pixel counts as saturated, and share of saturated pixels that is too many.
const SATURATED: u8 = 254;
const MAX_SATURATED: f64 = 0.5;
/// Largest file [bytes].
const MAX_BYTES: u64 = 256 << 20;
/// Mean below which a picture is black.
const BLACK: f64 = 2e-4;
/// Rec. 709.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// A picture of linear RGB, from the top left.
#[derive(Clone, Debug)]
pub struct Photo {
    /// Columns and rows.
    pub size: [usize; 2],
    /// `[row][column]`: linear RGB, 1 for white.
    pub rgb: Vec<[f32; 3]>,
    /// `[row][column]`: whether a channel is saturated.
    pub is_saturated: Vec<bool>,
}

/// The sRGB code of a linear value.
pub fn encode(v: f32) -> u8 {
    (255.0 * srgb_encode(f64::from(v.clamp(0.0, 1.0))) + 0.5) as u8
}

/// A PNG file of sRGB codes, `[row][column]`.
pub fn png(size: [usize; 2], codes: &[[u8; 3]]) -> std::result::Result<Vec<u8>, png::EncodingError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, size[0] as u32, size[1] as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(codes.as_flattened())?;
    Ok(out)
}

/// Luminance of linear RGB.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    (0..3).map(|k| LUMINANCE[k] * rgb[k]).sum()
}

impl Photo {
    /// Reads a PNG file in sRGB.
    ///
    /// # Errors
    /// Those of reading, and of [`Photo::from_png`].
    pub fn load(path: &Path) -> Result<Photo> {
        Photo::from_png(&io::read_file(path, MAX_BYTES)?, &path.display().to_string())
    }

    /// Reads a PNG file in sRGB; `file` identifies it in errors.
    ///
    /// # Errors
    /// [`Error::Format`] for what is no PNG file, for pictures too small or too large, black, or of which
    /// more than half is saturated.
    pub fn from_png(bytes: &[u8], file: &str) -> Result<Photo> {
        let refused = |what: String, hint: &str| Error::Format { file: file.into(), what, hint: hint.into() };
        if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            return Err(refused("no PNG file".into(), "save the photograph as PNG"));
        }
        let damaged =
            |e: png::DecodingError| refused(plywave::one_line(&e.to_string(), 120), "save the photograph again as PNG");
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 4 << 20 });
        decoder.set_transformations(png::Transformations::normalize_to_color8());
        let header = decoder.read_header_info().map_err(damaged)?;
        let size = [header.width as usize, header.height as usize];
        if size.iter().any(|side| !(SIDES[0]..=SIDES[1]).contains(side)) {
            let hint = format!("use {} to {} pixels along each side", SIDES[0], SIDES[1]);
            return Err(refused(format!("a picture of {} x {} pixels", size[0], size[1]), &hint));
        }
        let mut reader = decoder.read_info().map_err(damaged)?;
        let mut codes = vec![0; reader.output_buffer_size().unwrap_or(0)];
        let info = reader.next_frame(&mut codes).map_err(damaged)?;
        let channels = info.color_type.samples();
        let of =
            |pixel: &[u8]| -> [u8; 3] { if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] } };
        let table: [f32; 256] = std::array::from_fn(|code| srgb_decode(code as f64 / 255.0) as f32);
        let codes: Vec<[u8; 3]> = codes.chunks_exact(channels).map(of).collect();
        let rgb: Vec<[f32; 3]> = codes.iter().map(|c| c.map(|c| table[usize::from(c)])).collect();
        let is_saturated: Vec<bool> = codes.iter().map(|c| c.iter().any(|c| *c >= SATURATED)).collect();
        let photo = Photo { size, rgb, is_saturated };
        let count = photo.rgb.len() as f64;
        let mean = photo.rgb.iter().map(|rgb| f64::from(luminance(*rgb))).sum::<f64>() / count;
        if mean < BLACK {
            return Err(refused(format!("a black picture, mean {mean:.1e} of white"), "expose it longer"));
        }
        let share = photo.is_saturated.iter().filter(|s| **s).count() as f64 / count;
        if share > MAX_SATURATED {
            return Err(refused(format!("{:.0} % of the pixels are saturated", 100.0 * share), "expose it shorter"));
        }
        Ok(photo)
    }

    /// Luminances, `[row][column]`.
    pub fn luminances(&self) -> Vec<f32> {
        self.rgb.iter().map(|rgb| luminance(*rgb)).collect()
    }

    /// Place of a pixel's middle on the cloth [mm].
    pub fn place_mm(&self, geometry: &SwatchGeometry, [column, row]: [f64; 2]) -> [f64; 2] {
        let per = geometry.seen_mm() / self.size[0] as f64;
        [(column + 0.5 - 0.5 * self.size[0] as f64) * per, (0.5 * self.size[1] as f64 - row - 0.5) * per]
    }

    /// Light of the blocks, without the white patch.
    pub fn blocks(&self, white_px: Option<[f64; 4]>) -> Blocks {
        let mut all = Blocks { rgb: vec![[0.0; 3]; BLOCKS], saturated: vec![0.0; BLOCKS], covered: vec![0.0; BLOCKS] };
        let mut counts = vec![0.0; BLOCKS];
        let mut whole = vec![0.0; BLOCKS];
        for (i, rgb) in self.rgb.iter().enumerate() {
            let (column, row) = (i % self.size[0], i / self.size[0]);
            let block = row * SIDE / self.size[1] * SIDE + column * SIDE / self.size[0];
            whole[block] += 1.0;
            let is_white = white_px.is_some_and(|[left, top, right, bottom]| {
                (left..=right).contains(&(column as f64)) && (top..=bottom).contains(&(row as f64))
            });
            if is_white {
                continue;
            }
            counts[block] += 1.0;
            (0..3).for_each(|k| all.rgb[block][k] += f64::from(rgb[k]));
            all.saturated[block] += f64::from(u8::from(self.is_saturated[i]));
        }
        for block in 0..BLOCKS {
            all.covered[block] = counts[block] / f64::max(whole[block], 1.0);
            let per = 1.0 / f64::max(counts[block], 1.0);
            all.rgb[block] = all.rgb[block].map(|v| v * per);
            all.saturated[block] *= per;
        }
        all
    }
}

/// Mean light of the blocks of a picture, from the top left.
#[derive(Clone, Debug)]
pub struct Blocks {
    /// Linear RGB.
    pub rgb: Vec<[f64; 3]>,
    /// Share of saturated pixels.
    pub saturated: Vec<f64>,
    /// Share of the block that is cloth.
    pub covered: Vec<f64>,
}

/// Contrast of squares of 1, 2, 4 and 8 pixels: the deviation of their luminance over the mean of 32 x 32
/// pixels about them. For two pictures of one cloth with independent noise, it is the root of the covariance.
pub fn contrast(size: [usize; 2], pictures: [&[f32]; 2]) -> [f64; 4] {
    const AROUND: usize = 32;
    let tiles = size.map(|side| side / AROUND);
    let mut sums = [0.0; 4];
    for tile in 0..tiles[0] * tiles[1] {
        let (left, top) = (tile % tiles[0] * AROUND, tile / tiles[0] * AROUND);
        let square = |of: &[f32], x: usize, y: usize, k: usize| -> f64 {
            let rows = (y..y + k).map(|row| of[row * size[0] + x..][..k].iter().map(|v| f64::from(*v)).sum::<f64>());
            rows.sum::<f64>() / (k * k) as f64
        };
        let means = pictures.map(|of| square(of, left, top, AROUND).max(1e-12));
        for (sum, k) in sums.iter_mut().zip(SQUARES) {
            let per = AROUND / k;
            let product = |i: usize| -> f64 {
                let (x, y) = (left + i % per * k, top + i / per * k);
                (0..2).map(|p| square(pictures[p], x, y, k) / means[p] - 1.0).product()
            };
            *sum += (0..per * per).map(product).sum::<f64>() / (per * per) as f64;
        }
    }
    sums.map(|sum| (sum / (tiles[0] * tiles[1]).max(1) as f64).max(0.0).sqrt())
}

/// Profiles of the luminance across and down, over its mean: means of 16 parts of the middle eighth of the
/// rows and of the columns.
pub fn profiles(size: [usize; 2], picture: &[f32]) -> [Vec<f64>; 2] {
    const PARTS: usize = 16;
    let mean = picture.iter().map(|v| f64::from(*v)).sum::<f64>() / picture.len() as f64;
    [false, true].map(|down| {
        let (length, other) = if down { (size[1], size[0]) } else { (size[0], size[1]) };
        let middle = other / 2 - other / 16..other / 2 + other / 16;
        let part = |i: usize| -> f64 {
            let along = i * length / PARTS..(i + 1) * length / PARTS;
            let count = (along.len() * middle.len()).max(1) as f64;
            let index = |at: usize, of: usize| if down { at * size[0] + of } else { of * size[0] + at };
            let sum = along.flat_map(|at| middle.clone().map(move |of| index(at, of)));
            sum.map(|i| f64::from(picture[i])).sum::<f64>() / (count * mean)
        };
        (0..PARTS).map(part).collect()
    })
}

/// Width of the streak across and down [pixels]: where the profile of rows (columns) beside the
/// middle, from 1/16 to 3/16 of the picture away, falls to half of its greatest value; `None` where it does
/// not. The lamp's image is not in those rows.
pub fn streak_widths(size: [usize; 2], picture: &[f32]) -> [Option<f64>; 2] {
    [false, true].map(|down| {
        let (length, other) = if down { (size[1], size[0]) } else { (size[0], size[1]) };
        let lines: Vec<f64> = (0..length)
            .map(|at| {
                let beside = |off: usize| [other / 2 - 1 - off, other / 2 + off];
                let of = (other / 16..3 * other / 16).flat_map(beside);
                let index = |of: usize| if down { at * size[0] + of } else { of * size[0] + at };
                of.map(|of| f64::from(picture[index(of)])).sum()
            })
            .collect();
        let smooth: Vec<f64> = lines.windows((length / 32).max(1)).map(|w| w.iter().sum()).collect();
        half_width(&smooth)
    })
}

/// Steps between the places where a profile falls to half of its greatest value.
fn half_width(profile: &[f64]) -> Option<f64> {
    let (top, most) = profile.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    let below = |v: &f64| *v < 0.5 * most;
    let right = top + profile[top..].iter().position(below)?;
    let left = profile[..top].iter().rposition(below)?;
    let part = |low: f64, high: f64| (0.5 * most - low) / (high - low);
    Some(
        (right as f64 - part(profile[right], profile[right - 1]))
            - (left as f64 + part(profile[left], profile[left + 1])),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(size: [u32; 2], pixel: impl Fn(usize) -> [u8; 3]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
        encoder.set_color(png::ColorType::Rgb);
        let pixels: Vec<u8> = (0..(size[0] * size[1]) as usize).flat_map(pixel).collect();
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        bytes
    }

    #[test]
    fn pictures_that_say_nothing_are_refused() {
        let refused = |bytes: &[u8]| Photo::from_png(bytes, "a.png").unwrap_err().to_string();
        assert!(refused(b"GIF89a").contains("a.png: no PNG file"));
        assert!(refused(&png([1, 1], |_| [90; 3])).contains("1 x 1 pixels"));
        assert!(refused(&png([64, 64], |_| [0; 3])).contains("black"));
        assert!(refused(&png([64, 64], |i| if i % 3 == 0 { [9; 3] } else { [255; 3] })).contains("67 % of the pixels"));
        let cut = png([64, 64], |_| [90; 3]);
        assert!(refused(&cut[..cut.len() / 2]).contains("save the photograph again"));
    }

    /// A checkerboard of 1 and 3: contrast 1/2 at one pixel, none at two; blocks have the mean, 2.
    #[test]
    fn contrast_and_blocks_of_a_checkerboard() {
        let values: Vec<f32> = (0..4096).map(|i| if (i / 64 + i % 64) % 2 == 0 { 1.0 } else { 3.0 }).collect();
        let [one, two, ..] = contrast([64, 64], [&values, &values]);
        assert!((one - 0.5).abs() < 1e-6 && two < 1e-6, "{one} {two}");
        let code = |v: f32| [encode(v / 4.0); 3];
        let photo = Photo::from_png(&png([64, 64], |i| code(values[i])), "a.png").unwrap();
        let blocks = photo.blocks(None);
        assert!(blocks.rgb.iter().all(|rgb| (rgb[1] - 0.5).abs() < 3e-3), "{:?}", blocks.rgb[0]);
        let masked = photo.blocks(Some([0.0, 0.0, 63.0, 7.0]));
        assert_eq!((masked.covered[0], masked.covered[SIDE]), (0.0, 1.0));
    }

    /// A bell of known width.
    #[test]
    fn widths_of_a_bell() {
        let bell = |x: f64, sd: f64| (-0.5 * (x / sd).powi(2)).exp();
        let pixel = |i: usize| (bell((i % 256) as f64 - 127.5, 20.0) + 1e-6) as f32;
        let picture: Vec<f32> = (0..256 * 256).map(pixel).collect();
        let [across, down] = streak_widths([256, 256], &picture);
        let want = 2.0 * 20.0 * (2.0 * 2f64.ln()).sqrt();
        assert!((across.unwrap() / want - 1.0).abs() < 0.02 && down.is_none(), "{across:?} {down:?}");
    }
}

//! Pictures of few colors from PNG files, of any bit depth. Sizes are checked in the header, before anything
//! is decoded.

use crate::MAX_THREADS;
use plywave::{Error, Result};
use std::io::Cursor;

/// Largest number of colors in a picture. Chosen: each needs a weave, and pictures for jacquards have 2 to
/// 16.
pub const MAX_COLORS: usize = 32;
/// Memory that the decoder may use for chunks beside the pixels [bytes].
const DECODER_BYTES: usize = 4 << 20;

/// A picture of few colors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Colors [sRGB, 0 to 255], in the order of their first pixels.
    pub colors: Vec<[u8; 3]>,
    /// `[row][column]`: indices of colors, from the top left.
    pub values: Vec<u8>,
}

/// A color as it is written.
pub(crate) fn hex(color: [u8; 3]) -> String {
    let [r, g, b] = color;
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Cause of a failure of the decoder.
fn what(error: &png::DecodingError) -> String {
    match error {
        png::DecodingError::LimitsExceeded => "chunks beside the pixels take too much memory".into(),
        png::DecodingError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => "the file is cut off".into(),
        other => plywave::one_line(&other.to_string(), 120),
    }
}

impl Pixels {
    /// Number of pixels of each color.
    pub fn counts(&self) -> Vec<usize> {
        let mut counts = vec![0; self.colors.len()];
        for value in &self.values {
            counts[usize::from(*value)] += 1;
        }
        counts
    }

    /// Reads a PNG file: gray, RGB or indexed, of 1 to 16 bits a channel; of 16 bits the upper 8 count.
    ///
    /// # Errors
    /// [`Error::Format`] for what is no PNG file, and for a picture that is larger than [`MAX_THREADS`], is
    /// transparent anywhere, or has more than [`MAX_COLORS`] colors.
    pub fn from_png(bytes: &[u8], file: &str) -> Result<Pixels> {
        let refused =
            |what: String, hint: &str| -> Error { Error::Format { file: file.into(), what, hint: hint.into() } };
        let damaged = |e: png::DecodingError| refused(what(&e), "save the picture again as PNG");
        if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            return Err(refused("no PNG file".into(), "save the picture as PNG"));
        }
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: DECODER_BYTES });
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        decoder.set_transformations(png::Transformations::normalize_to_color8());
        let header = decoder.read_header_info().map_err(damaged)?;
        let (width, height) = (header.width as usize, header.height as usize);
        if width > MAX_THREADS || height > MAX_THREADS {
            return Err(refused(
                format!("a picture of {width} x {height} pixels"),
                &format!("a pixel is an end and a pick: use {MAX_THREADS} x {MAX_THREADS} or less"),
            ));
        }
        let mut reader = decoder.read_info().map_err(damaged)?;
        let size = reader.output_buffer_size().unwrap_or(usize::MAX);
        // Four channels at most, of a byte each.
        if size > 4 * width * height {
            return Err(refused(format!("{size} bytes of pixels"), "save the picture again as PNG"));
        }
        let mut buffer = vec![0; size];
        let frame = reader.next_frame(&mut buffer).map_err(damaged)?;
        let channels = frame.color_type.samples();
        let pixels = buffer.chunks_exact(channels).take(width * height);
        if pixels.len() != width * height {
            return Err(refused("fewer pixels than the header says".into(), "save the picture again as PNG"));
        }
        if let Some(alpha) = [2, 4].contains(&channels).then(|| channels - 1) {
            let transparent = pixels.clone().filter(|pixel| pixel[alpha] != 255).count();
            if transparent > 0 {
                let what = format!("{transparent} transparent pixels");
                return Err(refused(what, "flatten the picture onto a color and save it without transparency"));
            }
        }
        let color = |pixel: &[u8]| if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
        Pixels::from_colors(width, height, pixels.map(color)).map_err(|count| {
            let hint = "reduce it to its few colors (indexed, without dither and antialiasing), one for each weave";
            refused(format!("a picture of {count} colors, where {MAX_COLORS} are the most"), hint)
        })
    }

    /// A picture from its colors, row by row from the top. The error is their number if there are too many.
    fn from_colors(
        width: usize,
        height: usize,
        pixels: impl Iterator<Item = [u8; 3]> + Clone,
    ) -> std::result::Result<Pixels, usize> {
        let mut colors: Vec<[u8; 3]> = Vec::new();
        let mut values = Vec::with_capacity(width * height);
        for color in pixels.clone() {
            let known = colors.iter().position(|c| *c == color);
            let at = known.unwrap_or_else(|| {
                colors.push(color);
                colors.len() - 1
            });
            if colors.len() > MAX_COLORS {
                return Err(count_colors(pixels));
            }
            values.push(at as u8);
        }
        Ok(Pixels { width, height, colors, values })
    }
}

/// Number of distinct colors.
fn count_colors(pixels: impl Iterator<Item = [u8; 3]>) -> usize {
    let mut seen = vec![0u64; 1 << 18];
    for [r, g, b] in pixels {
        let at = usize::from(r) << 16 | usize::from(g) << 8 | usize::from(b);
        seen[at / 64] |= 1 << (at % 64);
    }
    seen.iter().map(|word| word.count_ones() as usize).sum()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A PNG file of samples as they lie in the file.
    pub(crate) fn png_of(
        size: [u32; 2],
        color: png::ColorType,
        depth: png::BitDepth,
        palette: &[u8],
        samples: &[u8],
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if !palette.is_empty() {
            encoder.set_palette(palette.to_vec());
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(samples).unwrap();
        drop(writer);
        bytes
    }

    /// A PNG file of RGB pixels.
    pub(crate) fn rgb(width: usize, pixels: &[[u8; 3]]) -> Vec<u8> {
        let size = [width as u32, (pixels.len() / width) as u32];
        png_of(size, png::ColorType::Rgb, png::BitDepth::Eight, &[], pixels.as_flattened())
    }

    fn refused(bytes: &[u8]) -> String {
        Pixels::from_png(bytes, "a.png").unwrap_err().to_string()
    }

    #[test]
    fn pictures_of_each_kind_are_read() {
        use png::{BitDepth, ColorType};
        let (red, white) = ([255, 0, 0], [255; 3]);
        let want = Pixels { width: 3, height: 2, colors: vec![red, white], values: vec![0, 1, 1, 0, 0, 1] };
        let palette = [255, 0, 0, 255, 255, 255];
        let eight: Vec<u8> = [0, 1, 1, 0, 0, 1].iter().flat_map(|at| [red, white][*at]).collect();
        let sixteen: Vec<u8> = eight.iter().flat_map(|v| [*v, 7]).collect();
        let alpha: Vec<u8> = [0, 1, 1, 0, 0, 1].iter().flat_map(|at| [palette_of(*at), vec![255]].concat()).collect();
        fn palette_of(at: usize) -> Vec<u8> {
            [[255, 0, 0], [255; 3]][at].to_vec()
        }
        for (color, depth, palette, samples) in [
            (ColorType::Rgb, BitDepth::Eight, &[][..], &eight[..]),
            (ColorType::Rgb, BitDepth::Sixteen, &[], &sixteen),
            (ColorType::Rgba, BitDepth::Eight, &[], &alpha),
            (ColorType::Indexed, BitDepth::One, &palette, &[0b0110_0000, 0b0010_0000]),
            (ColorType::Indexed, BitDepth::Four, &palette, &[0x01, 0x10, 0x00, 0x10]),
            (ColorType::Indexed, BitDepth::Eight, &palette, &[0, 1, 1, 0, 0, 1]),
        ] {
            let bytes = png_of([3, 2], color, depth, palette, samples);
            assert_eq!(Pixels::from_png(&bytes, "a.png").unwrap(), want, "{color:?} {depth:?}");
        }
        let gray = png_of([2, 1], ColorType::Grayscale, BitDepth::Two, &[], &[0b0110_0000]);
        assert_eq!(Pixels::from_png(&gray, "a.png").unwrap().colors, [[0x55; 3], [0xaa; 3]]);
        assert_eq!(want.counts(), [3, 3]);
    }

    /// The size is refused from the header alone: the file has no pixels at all.
    #[test]
    fn large_pictures_are_refused_before_they_are_decoded() {
        let mut file = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR".to_vec();
        file.extend(60_000u32.to_be_bytes());
        file.extend(60_000u32.to_be_bytes());
        file.extend([8, 2, 0, 0, 0]);
        let crc = crc(&file[12..]);
        file.extend(crc.to_be_bytes());
        let error = refused(&file);
        assert_eq!(
            error,
            "a.png: a picture of 60000 x 60000 pixels; a pixel is an end and a pick: use 4096 x 4096 or less"
        );
    }

    /// CRC of a chunk, bit by bit (PNG specification, Annex D).
    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 })
        })
    }

    #[test]
    fn other_bad_pictures_are_refused_with_what_to_do() {
        let many: Vec<[u8; 3]> = (0..300u32).map(|k| [(k % 256) as u8, (k / 256) as u8, 9]).collect();
        let error = refused(&rgb(20, &many));
        assert!(error.starts_with("a.png: a picture of 300 colors, where 32 are the most; reduce it"), "{error}");
        let exactly: Vec<[u8; 3]> = (0..32).map(|k| [k, 0, 0]).collect();
        assert_eq!(Pixels::from_png(&rgb(8, &exactly), "a.png").unwrap().colors.len(), 32);
        let clear = [1, 2, 3, 255, 1, 2, 3, 254, 0, 0, 0, 0, 1, 1, 1, 255];
        let error = refused(&png_of([2, 2], png::ColorType::Rgba, png::BitDepth::Eight, &[], &clear));
        assert!(error.contains("2 transparent pixels; flatten the picture"), "{error}");
        assert!(refused(b"GIF89a").contains("no PNG file; save the picture as PNG"));
        assert!(refused(b"").contains("no PNG file"));
        let whole = rgb(20, &vec![[1, 2, 3]; 400]);
        for cut in 8..whole.len() - 12 {
            let error = refused(&whole[..cut]);
            assert!(error.ends_with("; save the picture again as PNG"), "{cut}: {error}");
        }
    }

    /// Any change of a byte gives a picture or an error, and no panic.
    #[test]
    fn damaged_files_do_not_panic() {
        let whole = rgb(7, &(0..49).map(|k| [k, 2 * k, 0].map(|v| v / 16 * 16)).collect::<Vec<_>>());
        for at in 0..whole.len() {
            for flip in [1, 0x80, 0xff] {
                let mut bytes = whole.clone();
                bytes[at] ^= flip;
                let _ = Pixels::from_png(&bytes, "a.png");
            }
        }
    }
}

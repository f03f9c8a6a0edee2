//! A cloth in the geometry of photographs of cloths, and its figures beside those of a photograph.
//!
//! `cargo run --release -p plywave-studies --bin photographs -- CLOTH.pwc TURN_DEGREES SAMPLES [R.png T.png]`
//!
//! The geometry is that of Tang et al. 2024, "Woven Fabric Capture with a Reflection-Transmission Photo
//! Pair": the cloth is a plane, a camera 80 mm above it sees 80 mm of it, a small lamp is 80 mm in front
//! of it and as far up, or 90 mm behind it. The lens darkens its picture by cos^4, as a thin lens does.
//! `TURN_DEGREES` turns the cloth, whose warp runs up the picture. `SAMPLES` are those of a pixel, each
//! with a point of the lamp, of the light of a lamp alone: a cloth that hangs free.
//!
//! For each picture it prints, of the luminance over its mean,
//!
//! - contrast: the deviation of squares of 1, 2, 4 and 8 pixels over the mean of their 32 x 32 pixels,
//!   without the noise of samples, as the root of the covariance of two pictures;
//! - profiles across and down: means of 16 blocks of the middle 64 rows and columns;
//! - widths at half of the greatest value of the profiles of 64 rows and columns on both sides of those,
//!   where no lamp shows, smoothed over 16 pixels, in mm;
//!
//! and with photographs (8-bit sRGB, 512 x 512) theirs, and the correlation of profiles. In the
//! environment, `PNG` names a folder for the cloth's pictures, `SRGB` (three numbers from 0 to 1 with
//! commas) is a color of all yarns in place of the cloth's.

use plywave::cloth::{ClothModel, ClothOptions, YarnColor};
use plywave::{Bsdf, ClothQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::f32::consts::TAU;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Pixels along a side, and of a block.
const SIZE: usize = 512;
const BLOCK: usize = 32;
/// Length that is seen, distance of the camera, and radius of the lamps [mm].
const SEEN_MM: f32 = 79.77;
const CAMERA_MM: f32 = 80.0;
const LAMP_MM: f32 = 1.5;
/// Rec. 709.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

fn main() -> Outcome<()> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let (cloth, turn, samples, photographs) = match given.as_slice() {
        [cloth, turn, samples] => (cloth, turn, samples, None),
        [cloth, turn, samples, front, behind] => (cloth, turn, samples, Some([front, behind])),
        _ => return Err("CLOTH.pwc TURN_DEGREES SAMPLES [R.png T.png]".into()),
    };
    let (turn, samples) = (turn.parse::<f32>()?.to_radians(), samples.parse()?);
    let cloth = ClothModel::load(cloth, &ClothOptions { far: false, ..ClothOptions::default() })?;
    let cloth = match std::env::var("SRGB") {
        Ok(text) => {
            let numbers = text.split(',').map(str::parse).collect::<Result<Vec<f32>, _>>()?;
            let srgb = numbers.try_into().map_err(|_| "SRGB: three numbers")?;
            cloth.with_colors([YarnColor::Srgb(srgb); 2], cloth.color_of())
        }
        Err(_) => cloth,
    };
    for (k, (name, lamp)) in [("R", [0.0, 80.0, 80.0]), ("T", [0.0, 0.0, -90.0])].into_iter().enumerate() {
        let pictures = render(&cloth, turn, lamp, samples);
        let ours = Figures::new(&pictures.each_ref().map(|of| of.iter().map(|rgb| luminance(*rgb)).collect()));
        println!("{name} cloth: {ours}");
        if let Some(files) = photographs {
            let theirs = photograph(files[k])?;
            let theirs = Figures::new(&[theirs.clone(), theirs]);
            println!("{name} photograph: {theirs}");
            let [across, down] = [0, 1].map(|way| correlation(&ours.profiles[way], &theirs.profiles[way]));
            println!("{name} correlation of profiles: across {across:.3}, down {down:.3}");
        }
        if let Some(folder) = std::env::var_os("PNG") {
            let mean = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
            let picture: Vec<[f32; 3]> = pictures[0].iter().zip(&pictures[1]).map(mean).collect();
            write(&std::path::Path::new(&folder).join(format!("{name}.png")), &picture)?;
        }
    }
    Ok(())
}

fn luminance(rgb: [f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(LUMINANCE[k] * rgb[k])).sum()
}

/// Two pictures, each of half of the samples.
fn render(cloth: &ClothModel, turn: f32, lamp_mm: [f32; 3], samples: usize) -> [Vec<[f32; 3]>; 2] {
    [0, 1].map(|seed| render_half(cloth, turn, lamp_mm, samples.div_ceil(2), seed))
}

/// Linear RGB of the cloth before a lamp at this place [mm].
fn render_half(cloth: &ClothModel, turn: f32, lamp_mm: [f32; 3], samples: usize, seed: usize) -> Vec<[f32; 3]> {
    let pixel = |i: usize| {
        let mut rng = Pcg64Mcg::seed_from_u64((2 * i + seed) as u64);
        let (column, row) = (i % SIZE, i / SIZE);
        let mut sum = [0.0; 3];
        for _ in 0..samples {
            let mut at = |pixel: usize| ((pixel as f32 + rng.random::<f32>()) / SIZE as f32 - 0.5) * SEEN_MM;
            let [x, y] = [at(column), -at(row)];
            let wo = unit([-x, -y, CAMERA_MM]);
            // A point of the lamp's disk, seen from the cloth.
            let to_lamp = [lamp_mm[0] - x, lamp_mm[1] - y, lamp_mm[2]];
            let towards = unit(to_lamp);
            let side = unit([towards[2], 0.0, -towards[0]]);
            let up = cross(towards, side);
            let (radius, angle) = (LAMP_MM * rng.random::<f32>().sqrt(), TAU * rng.random::<f32>());
            let (s, c) = angle.sin_cos();
            let point: [f32; 3] = std::array::from_fn(|k| to_lamp[k] + radius * (c * side[k] + s * up[k]));
            let squared = dot(point, point);
            let query = ClothQuery { turn_rad: turn, ..ClothQuery::rgb([1e3 * x, 1e3 * y], wo) };
            let cloth = cloth.at(&query);
            let (f, lens) = (cloth.eval(unit(point)), wo[2].powi(4));
            (0..3).for_each(|k| sum[k] += lens * f[k] * CAMERA_MM * CAMERA_MM / squared);
            // The lamp itself, through gaps, of radiance that gives the cloth an irradiance of 1 at 80 mm.
            let seen = dot(wo.map(|v| -v), towards);
            if lamp_mm[2] < 0.0 && 1.0 - seen * seen < LAMP_MM * LAMP_MM / dot(to_lamp, to_lamp) {
                let radiance = CAMERA_MM * CAMERA_MM / (std::f32::consts::PI * LAMP_MM * LAMP_MM);
                let straight = cloth.straight();
                (0..3).for_each(|k| sum[k] += lens * radiance * straight[k]);
            }
        }
        sum.map(|v| v / samples as f32)
    };
    (0..SIZE * SIZE).into_par_iter().map(pixel).collect()
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt();
    v.map(|v| v / length)
}

/// What is measured in a picture of luminances.
struct Figures {
    mean: f64,
    contrast: [f64; 4],
    /// Across and down, of 16 blocks.
    profiles: [Vec<f64>; 2],
    /// Of the profiles [mm].
    widths_mm: [Option<f64>; 2],
}

impl Figures {
    /// Of two pictures whose noise is independent, or of one twice.
    fn new(pictures: &[Vec<f64>; 2]) -> Figures {
        let picture: Vec<f64> = pictures[0].iter().zip(&pictures[1]).map(|(a, b)| 0.5 * (a + b)).collect();
        let mean = picture.iter().sum::<f64>() / picture.len() as f64;
        let squares = |picture: &[f64], k: usize| -> Vec<f64> {
            let side = SIZE / k;
            let square = |i: usize| {
                let (row, column) = (i / side * k, i % side * k);
                let rows = (row..row + k).map(|r| picture[r * SIZE + column..][..k].iter().sum::<f64>());
                rows.sum::<f64>() / (k * k) as f64
            };
            (0..side * side).map(square).collect()
        };
        let blocks = squares(&picture, BLOCK);
        let side = SIZE / BLOCK;
        let contrast = [1, 2, 4, 8].map(|k| {
            let (of, per) = (pictures.each_ref().map(|picture| squares(picture, k)), BLOCK / k);
            let product = |i: usize| {
                let (row, column) = (i / (SIZE / k) / per, i % (SIZE / k) / per);
                of.iter().map(|of| of[i] / blocks[row * side + column] - 1.0).product::<f64>()
            };
            let count = of[0].len();
            ((0..count).map(product).sum::<f64>() / count as f64).max(0.0).sqrt()
        });
        let middle = [side / 2 - 1, side / 2];
        let profiles = [false, true].map(|down| {
            let block = |at: usize, of: usize| if down { blocks[at * side + of] } else { blocks[of * side + at] };
            (0..side).map(|at| middle.iter().map(|of| block(at, *of)).sum::<f64>() / (2.0 * mean)).collect()
        });
        let widths_mm = [false, true].map(|down| {
            let line = |at: usize| -> f64 {
                let beside = |off: usize| [SIZE / 2 - 1 - off, SIZE / 2 + off];
                let of = (BLOCK..3 * BLOCK).flat_map(beside);
                of.map(|of| picture[if down { at * SIZE + of } else { of * SIZE + at }]).sum()
            };
            let lines: Vec<f64> = (0..SIZE).map(line).collect();
            let smooth: Vec<f64> = lines.windows(16).map(|w| w.iter().sum::<f64>()).collect();
            half_width(&smooth).map(|pixels| pixels * f64::from(SEEN_MM) / SIZE as f64)
        });
        Figures { mean, contrast, profiles, widths_mm }
    }
}

/// Pixels between the places where a profile falls to half of its greatest value; none where it does not.
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

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mean {:.4}, contrast", self.mean)?;
        self.contrast.iter().try_for_each(|c| write!(f, " {c:.3}"))?;
        for (way, name) in ["across", "down"].into_iter().enumerate() {
            match self.widths_mm[way] {
                Some(width) => write!(f, "; {name}, {width:.1} mm wide:")?,
                None => write!(f, "; {name}, wider than the picture:")?,
            }
            self.profiles[way].iter().try_for_each(|v| write!(f, " {v:.2}"))?;
        }
        Ok(())
    }
}

/// Pearson's.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(a, b)| f(a - ma, b - mb)).sum::<f64>();
    sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt()
}

/// Luminances of a photograph.
fn photograph(file: &str) -> Outcome<Vec<f64>> {
    let mut reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(file)?)).read_info()?;
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("a picture too large")?];
    let info = reader.next_frame(&mut bytes)?;
    let channels = info.color_type.samples();
    if (info.width, info.height) != (SIZE as u32, SIZE as u32) || info.bit_depth != png::BitDepth::Eight || channels < 3
    {
        return Err(format!("{file}: expected 512 x 512 pixels of 8-bit RGB").into());
    }
    let linear = |code: u8| {
        let v = f32::from(code) / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    Ok(bytes.chunks_exact(channels).map(|p| luminance([p[0], p[1], p[2]].map(linear))).collect())
}

/// A PNG whose mean luminance is that of a middle gray.
fn write(file: &std::path::Path, picture: &[[f32; 3]]) -> Outcome<()> {
    let mean = picture.iter().map(|rgb| luminance(*rgb)).sum::<f64>() / picture.len() as f64;
    let scale = (0.18 / mean) as f32;
    let encode = |v: f32| {
        let v = (scale * v).clamp(0.0, 1.0);
        let v = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (255.0 * v + 0.5) as u8
    };
    let bytes: Vec<u8> = picture.iter().flat_map(|rgb| rgb.map(encode)).collect();
    let mut encoder = png::Encoder::new(std::fs::File::create(file)?, SIZE as u32, SIZE as u32);
    encoder.set_color(png::ColorType::Rgb);
    Ok(encoder.write_header()?.write_image_data(&bytes)?)
}

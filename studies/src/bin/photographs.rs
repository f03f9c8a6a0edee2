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
use plywave_pipeline::swatch::{
    Photo, Shot, SwatchGeometry, contrast, encode, luminance, png, profiles, streak_widths,
};
use plywave_wave::correlation;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const SIZE: [usize; 2] = [512; 2];

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
    let geometry = SwatchGeometry::default();
    for (k, name) in ["R", "T"].into_iter().enumerate() {
        let shot = Shot {
            cloth: &cloth,
            turn_rad: turn,
            geometry: &geometry,
            size: SIZE,
            part: [0, 0, SIZE[0], SIZE[1]],
            samples: u32::div_ceil(samples, 2),
            seed: 0,
        };
        let halves = [1, 2].map(|seed| Shot { seed, ..shot }.render(k == 1));
        let ours = Figures::new(&halves.each_ref().map(|of| of.iter().map(|rgb| luminance(*rgb)).collect()), &geometry);
        println!("{name} cloth: {ours}");
        if let Some(files) = photographs {
            let theirs = photograph(files[k])?;
            let theirs = Figures::new(&[theirs.clone(), theirs], &geometry);
            println!("{name} photograph: {theirs}");
            let [across, down] = [0, 1].map(|way| correlation(&ours.profiles[way], &theirs.profiles[way]));
            println!("{name} correlation of profiles: across {across:.3}, down {down:.3}");
        }
        if let Some(folder) = std::env::var_os("PNG") {
            let mean = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
            let picture: Vec<[f32; 3]> = halves[0].iter().zip(&halves[1]).map(mean).collect();
            write(&std::path::Path::new(&folder).join(format!("{name}.png")), &picture)?;
        }
    }
    Ok(())
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
    fn new(pictures: &[Vec<f32>; 2], geometry: &SwatchGeometry) -> Figures {
        let picture: Vec<f32> = pictures[0].iter().zip(&pictures[1]).map(|(a, b)| 0.5 * (a + b)).collect();
        let mm = geometry.seen_mm() / SIZE[0] as f64;
        Figures {
            mean: picture.iter().map(|v| f64::from(*v)).sum::<f64>() / picture.len() as f64,
            contrast: contrast(SIZE, [&pictures[0], &pictures[1]]),
            profiles: profiles(SIZE, &picture),
            widths_mm: streak_widths(SIZE, &picture).map(|width| width.map(|pixels| pixels * mm)),
        }
    }
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

/// Luminances of a photograph.
fn photograph(file: &str) -> Outcome<Vec<f32>> {
    let photo = Photo::load(file.as_ref())?;
    if photo.size != SIZE {
        return Err(format!("{file}: expected 512 x 512 pixels").into());
    }
    Ok(photo.luminances())
}

/// A PNG whose mean luminance is that of a middle gray.
fn write(file: &std::path::Path, picture: &[[f32; 3]]) -> Outcome<()> {
    let mean = picture.iter().map(|rgb| f64::from(luminance(*rgb))).sum::<f64>() / picture.len() as f64;
    let scale = (0.18 / mean) as f32;
    let codes: Vec<[u8; 3]> = picture.iter().map(|rgb| rgb.map(|v| encode(scale * v))).collect();
    Ok(std::fs::write(file, png(SIZE, &codes)?)?)
}

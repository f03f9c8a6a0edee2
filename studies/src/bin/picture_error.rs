//! How far pictures are from a clean one of the same scene: relative squared error, and white specks.
//!
//! `cargo run --release -p plywave-studies --bin picture_error -- CLEAN.exr PICTURE.exr..`
//!
//! The error of a pixel is squared, over the square of the clean one plus a hundredth of its mean's; specks
//! are brighter than 20 times the median of the 5 x 5 pixels around. Green alone counts.

#[path = "../picture.rs"]
mod picture;

use picture::{Outcome, Picture};

/// Pixels beside one, on each side, whose median it is held to.
const BESIDE: usize = 2;
const SPECK: f64 = 20.0;

fn specks(of: &Picture) -> usize {
    let at = |x: usize, y: usize| {
        let (left, right) = (x.saturating_sub(BESIDE), (x + BESIDE).min(of.width - 1));
        let (top, bottom) = (y.saturating_sub(BESIDE), (y + BESIDE).min(of.height - 1));
        let mut around: Vec<f64> =
            (top..=bottom).flat_map(|j| (left..=right).map(move |i| of.green[j * of.width + i])).collect();
        around.sort_by(f64::total_cmp);
        around[around.len() / 2]
    };
    let pixels = (0..of.height).flat_map(|y| (0..of.width).map(move |x| (x, y)));
    pixels.filter(|(x, y)| of.green[y * of.width + x] > SPECK * at(*x, *y).max(1e-4)).count()
}

fn main() -> Outcome<()> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let [clean, pictures @ ..] = files.as_slice() else { return Err("CLEAN.exr PICTURE.exr..".into()) };
    let clean = Picture::load(clean)?;
    let mean = clean.green.iter().sum::<f64>() / clean.green.len() as f64;
    for file in pictures {
        let picture = Picture::load(file)?;
        if (picture.width, picture.height) != (clean.width, clean.height) {
            return Err(format!("{file}: not as large as the clean picture").into());
        }
        let errors = picture.green.iter().zip(&clean.green);
        let errors = errors.map(|(got, want)| (got - want).powi(2) / (want * want + 0.01 * mean * mean));
        let error = errors.sum::<f64>() / clean.green.len() as f64;
        let noise = picture.variance.iter().sum::<f64>() / (picture.variance.len() as f64 * mean * mean);
        println!("{file}: relative squared error {error:.5}, variance {noise:.5}, {} specks", specks(&picture));
    }
    Ok(())
}

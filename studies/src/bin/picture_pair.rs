//! A picture of a cloth's model beside that of its fibers: mean, contrast, and power spectra by octaves.
//!
//! `cargo run --release -p plywave-studies --bin picture_pair -- FIBERS.exr MODEL.exr PIXEL_UM`
//!
//! Both are EXRs of `plywave render` of one scene, camera and size; green alone counts. What noise adds to
//! variances and spectra is taken off by the pictures' own `variance.G`: samples of pixels are independent.
//! A row of the table is an octave of wavelengths, from two pixels up, across the picture and down it.

#[path = "../picture.rs"]
mod picture;

use picture::{Outcome, Picture};
use rustfft::{FftPlanner, num_complex::Complex};

impl Picture {
    fn mean(&self) -> f64 {
        self.green.iter().sum::<f64>() / self.green.len() as f64
    }

    fn noise(&self) -> f64 {
        self.variance.iter().sum::<f64>() / self.variance.len() as f64
    }

    /// Standard deviation over the mean, noise taken off.
    fn contrast(&self) -> f64 {
        let mean = self.mean();
        let all = self.green.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / self.green.len() as f64;
        (all - self.noise()).max(0.0).sqrt() / mean
    }

    /// Share of the variance over the squared mean in each octave of wavelengths along rows, or down columns:
    /// the first from 2 to 4 pixels.
    fn octaves(&self, down: bool) -> Vec<f64> {
        let (length, lines) = if down { (self.height, self.width) } else { (self.width, self.height) };
        let fft = FftPlanner::new().plan_fft_forward(length);
        let mean = self.mean();
        let mut power = vec![0.0; length / 2 + 1];
        for line in 0..lines {
            let at = |i: usize| if down { i * self.width + line } else { line * self.width + i };
            let mut values: Vec<Complex<f64>> =
                (0..length).map(|i| Complex::new(self.green[at(i)] / mean - 1.0, 0.0)).collect();
            fft.process(&mut values);
            for (k, sum) in power.iter_mut().enumerate() {
                *sum += values[k].norm_sqr() / (length as f64 * length as f64 * lines as f64);
            }
        }
        // White noise has the same power in each harmonic.
        let floor = self.noise() / (mean * mean * length as f64);
        let (mut octaves, mut high) = (Vec::new(), length / 2);
        while high >= 2 {
            let low = high / 2;
            octaves.push((low + 1..=high).map(|k| 2.0 * (power[k] - floor)).sum::<f64>());
            high = low;
        }
        octaves
    }
}

fn main() -> Outcome<()> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let [fibers, model, pixel_um] = given.as_slice() else { return Err("FIBERS.exr MODEL.exr PIXEL_UM".into()) };
    let pixel_um: f64 = pixel_um.parse()?;
    let [fibers, model] = [Picture::load(fibers)?, Picture::load(model)?];
    if (fibers.width, fibers.height) != (model.width, model.height) {
        return Err("the pictures have different sizes".into());
    }
    let ratio = |of: f64, to: f64| if to > 0.0 { format!("{:.2}", of / to) } else { "-".into() };
    println!("mean {:.5} {:.5}, model over fibers {:.3}", fibers.mean(), model.mean(), model.mean() / fibers.mean());
    let contrasts = [fibers.contrast(), model.contrast()];
    println!("contrast {:.4} {:.4}, ratio {}", contrasts[0], contrasts[1], ratio(contrasts[1], contrasts[0]));
    println!("wavelength [um]: power over the squared mean of fibers, model, ratio: across; down");
    let [across, down] = [false, true].map(|down| [fibers.octaves(down), model.octaves(down)]);
    for octave in 0..across[0].len().max(down[0].len()) {
        let of = |pair: &[Vec<f64>; 2]| match [pair[0].get(octave), pair[1].get(octave)] {
            [Some(a), Some(b)] => format!("{a:.2e} {b:.2e} {}", ratio(*b, *a)),
            _ => String::new(),
        };
        let low = 2.0 * pixel_um * f64::from(1u32 << octave);
        println!("{low:.0} to {:.0}: {}; {}", 2.0 * low, of(&across), of(&down));
    }
    Ok(())
}

//! Environment light: a picture in latitude and longitude with constant radiance over each texel, its
//! spectrum by wavelength, and sampling by power.

use crate::spectrum::Light4;
use crate::{LAMBDA_RANGE_UM, RenderError};
use glam::{DMat3, DVec3, Vec3};
use plywave::color;
use std::f64::consts::{PI, TAU};

/// Wavelengths that separate the blue, green and red bands of a sky's spectrum [um].
const BAND_EDGES_UM: [f32; 2] = [0.49, 0.59];

/// Light from infinitely far: radiance over the sphere, z up, relative to the illuminant's spectrum.
///
/// A texel's spectrum is the illuminant's times one factor in each of three bands: below 0.49 um, from there
/// to 0.59 um, and above. The factors reproduce the texel's color, so a sky seen directly or through gray
/// reflectors has the colors of its picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    width: usize,
    height: usize,
    /// Radiance of each texel in the red, green and blue bands; rows go from the zenith down.
    texels: Vec<[f32; 3]>,
    /// Cumulative sums for sampling: power over the rows, and radiance over the texels of each row.
    rows: Vec<f64>,
    columns: Vec<f64>,
}

/// Sampling weight of a texel: its radiance summed over the bands.
fn weight(texel: &[f32; 3]) -> f64 {
    texel.iter().copied().map(f64::from).sum()
}

/// Matrix from linear sRGB to the factors of the three bands that have that color. No entry is negative, so
/// sRGB colors have non-negative factors.
fn bands_of_srgb() -> DMat3 {
    const STEP_UM: f64 = 1e-4;
    let [low, high] = LAMBDA_RANGE_UM.map(f64::from);
    let mut columns = [DVec3::ZERO; 3];
    for k in 0..((high - low) / STEP_UM).round() as usize {
        let lambda = low + (k as f64 + 0.5) * STEP_UM;
        columns[band(lambda as f32)] += DVec3::from(color::linear_srgb_of_xyz(color::d65_xyz_density(lambda)));
    }
    // Equal factors in all bands give white.
    let white = columns[0] + columns[1] + columns[2];
    DMat3::from_cols(columns[0] / white, columns[1] / white, columns[2] / white).inverse()
}

/// Index of the band of a wavelength: 0 for red, 1 for green, 2 for blue.
fn band(lambda_um: f32) -> usize {
    BAND_EDGES_UM.iter().filter(|edge| lambda_um < **edge).count()
}

impl Environment {
    /// An environment with the same radiance in all directions.
    pub fn constant(radiance: f32) -> Environment {
        Environment::new(1, 1, vec![[radiance; 3]])
    }

    /// An environment with the same radiance in all directions above the horizon and no light below it.
    pub fn above(radiance: f32) -> Environment {
        Environment::new(1, 2, vec![[radiance; 3], [0.0; 3]])
    }

    /// An environment from a picture in latitude and longitude, `srgb[row][column]`, linear sRGB. Rows go
    /// from the zenith down. The middle column looks along x; columns to its right look further to the right,
    /// towards -y, as seen from inside (the convention of Blender).
    ///
    /// # Errors
    /// [`RenderError::Picture`] for an empty picture, incomplete rows, and negative, infinite or NaN values.
    pub fn picture(width: usize, mut srgb: Vec<[f32; 3]>) -> Result<Environment, RenderError> {
        let bad = |what: String| RenderError::Picture { file: "sky".into(), what };
        if width == 0 || srgb.is_empty() || !srgb.len().is_multiple_of(width) {
            return Err(bad(format!("{} texels in rows of {width}; give whole rows", srgb.len())));
        }
        let wrong = |v: &f32| !v.is_finite() || *v < 0.0;
        if let Some((at, value)) = srgb.iter().flatten().enumerate().find(|(_, v)| wrong(v)) {
            let (x, y, channel) = (at / 3 % width, at / 3 / width, ["R", "G", "B"][at % 3]);
            return Err(bad(format!(
                "{channel} of texel ({x}, {y}) is {value}; radiances are finite and not negative"
            )));
        }
        let bands = bands_of_srgb();
        for texel in &mut srgb {
            // Grays keep their values bit for bit.
            if texel[0] != texel[1] || texel[1] != texel[2] {
                *texel = (bands * DVec3::from(texel.map(f64::from))).as_vec3().max(Vec3::ZERO).to_array();
            }
        }
        Ok(Environment::new(width, srgb.len() / width, srgb))
    }

    /// An environment from the texels' radiances in the bands.
    fn new(width: usize, height: usize, texels: Vec<[f32; 3]>) -> Environment {
        let (mut rows, mut columns) = (Vec::with_capacity(height), Vec::with_capacity(texels.len()));
        let mut all = 0.0;
        for (j, row) in texels.chunks_exact(width).enumerate() {
            let mut sum = 0.0;
            for texel in row {
                sum += weight(texel);
                columns.push(sum);
            }
            all += sum * solid_angle(j, width, height);
            rows.push(all);
        }
        Environment { width, height, texels, rows, columns }
    }

    /// Power of the environment, its sampling weight.
    fn power(&self) -> f64 {
        self.rows.last().copied().unwrap_or(0.0)
    }

    /// Whether the environment emits no light.
    pub fn is_dark(&self) -> bool {
        self.power() <= 0.0
    }

    /// Whether the radiance is the same in all directions.
    pub(crate) fn is_even(&self) -> bool {
        self.texels.len() == 1
    }

    /// Index of the texel in a direction.
    pub(crate) fn texel(&self, direction: Vec3) -> usize {
        let d = direction.as_dvec3();
        // The angle from z uses both its sine and cosine: near the poles the cosine alone does not separate
        // the rows of large pictures.
        let v = d.x.hypot(d.y).atan2(d.z) / PI;
        let u = 0.5 - d.y.atan2(d.x) / TAU;
        let i = ((u - u.floor()) * self.width as f64) as usize;
        let j = (v * self.height as f64) as usize;
        j.min(self.height - 1) * self.width + i.min(self.width - 1)
    }

    /// Radiance of a texel at wavelengths [um].
    pub(crate) fn radiance(&self, texel: usize, lambda_um: Light4) -> Light4 {
        lambda_um.map(|l| self.texels[texel][band(l)])
    }

    /// Density [1/sr] of sampling a direction within a texel: texels are sampled by power, directions within
    /// a texel uniformly.
    pub(crate) fn pdf(&self, texel: usize) -> f32 {
        (weight(&self.texels[texel]) / self.power().max(f64::MIN_POSITIVE)) as f32
    }

    /// Samples a direction and its texel from two uniform numbers.
    pub(crate) fn sample(&self, u: [f64; 2]) -> (Vec3, usize) {
        let (j, v) = find(&self.rows, u[0]);
        let (i, w) = find(&self.columns[j * self.width..(j + 1) * self.width], u[1]);
        let [upper, lower] = [j, j + 1].map(|k| (PI * k as f64 / self.height as f64).cos());
        let z = upper + v * (lower - upper);
        let (sin, phi) = ((1.0 - z * z).max(0.0).sqrt(), TAU * (0.5 - (i as f64 + w) / self.width as f64));
        (DVec3::new(sin * phi.cos(), sin * phi.sin(), z).as_vec3(), j * self.width + i)
    }
}

/// Solid angle of a texel in row `j` [sr]: its width times the difference of its edges' cosines, as a product
/// that avoids cancellation.
fn solid_angle(j: usize, width: usize, height: usize) -> f64 {
    let half = 0.5 * PI / height as f64;
    2.0 * (half * (2 * j + 1) as f64).sin() * half.sin() * TAU / width as f64
}

/// Index of the cumulative sum that contains `share` of the total, and the fraction within that entry, 0 to
/// 1.
fn find(sums: &[f64], share: f64) -> (usize, f64) {
    let target = share * sums.last().copied().unwrap_or(0.0);
    let k = sums.partition_point(|s| *s <= target).min(sums.len().saturating_sub(1));
    let before = if k == 0 { 0.0 } else { sums[k - 1] };
    (k, ((target - before) / (sums[k] - before).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn skies_sample_what_their_pdf_says() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let texels: Vec<[f32; 3]> = (0..8 * 4).map(|_| rng.random()).collect();
        let sky = Environment::picture(8, texels).unwrap();
        // The mean of radiance / pdf is the integral of the radiance; the mean of 1 / pdf is 4 pi.
        let n = 200_000;
        let (mut sums, mut squares) = ([0.0f64; 2], [0.0f64; 2]);
        for _ in 0..n {
            let (direction, texel) = sky.sample(rng.random());
            assert_eq!(sky.texel(direction), texel);
            let inverse = 1.0 / f64::from(sky.pdf(texel));
            for (k, v) in [inverse, inverse * f64::from(sky.radiance(texel, [0.55; 4])[0])].into_iter().enumerate() {
                sums[k] += v;
                squares[k] += v * v;
            }
        }
        let want: f64 = (0..32).map(|k| f64::from(sky.texels[k][1]) * solid_angle(k / 8, 8, 4)).sum();
        for (k, want) in [4.0 * PI, want].into_iter().enumerate() {
            let mean = sums[k] / f64::from(n);
            let se = ((squares[k] / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
            assert!((mean - want).abs() < 5.0 * se, "{k}: {mean}, want {want}, standard error {se}");
        }
    }

    #[test]
    fn columns_turn_right_from_x_in_the_middle() {
        let sky = Environment::picture(8, vec![[1.0; 3]; 32]).unwrap();
        let at = |x: f32, y: f32, z: f32| sky.texel(Vec3::new(x, y, z).normalize());
        assert_eq!([at(1.0, 0.1, 0.1), at(1.0, -0.1, -0.1)], [8 + 3, 16 + 4]);
        assert_eq!([at(0.1, -1.0, 0.1), at(-0.1, 1.0, 0.1)], [8 + 5, 8 + 1]);
        assert_eq!([at(-1.0, 0.1, 0.1), at(-1.0, -0.1, 0.1)], [8, 8 + 7]);
        assert!(at(0.0, 0.0, 1.0) < 8 && at(0.0, 0.0, -1.0) >= 24);
    }

    #[test]
    fn texels_of_large_pictures_are_told_apart() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        // The rows are as narrow as those of 16384 x 8192 texels, where the first and last rows lie within a
        // thousandth of a radian of the poles; the columns of the second picture are as narrow.
        for (width, height) in [(4, 8192), (16384, 16)] {
            for row in [0, 1, height / 2, height - 2, height - 1] {
                let mut texels = vec![[0.0; 3]; width * height];
                let sun = row * width + width / 3;
                texels[sun] = [1.0; 3];
                let sky = Environment::picture(width, texels).unwrap();
                let mut beside = 0;
                for _ in 0..10_000 {
                    let (direction, texel) = sky.sample(rng.random());
                    assert_eq!(texel, sun);
                    beside += usize::from(sky.texel(direction) != sun);
                }
                // Directions have 24 bits, so some at a texel's edge fall into its neighbor.
                assert!(beside < 20, "{width} x {height}, row {row}: {beside} beside");
                let want = 1.0 / solid_angle(row, width, height);
                assert!((f64::from(sky.pdf(sun)) / want - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_sun_and_a_dark_sky_are_drawn_by_their_power() {
        // A million texels of the sky together have as much power as the sun's texel.
        let (width, height) = (16384, 64);
        let mut texels = vec![[1e-6f32; 3]; width * height];
        let sun = 5 * width + 9000;
        texels[sun] = [0.0; 3];
        let dark = Environment::picture(width, texels.clone()).unwrap().power();
        texels[sun] = [(dark / 3.0 / solid_angle(5, width, height)) as f32; 3];
        let sky = Environment::picture(width, texels).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let n = 100_000;
        let (mut suns, mut blocks) = (0, [0; 16]);
        for _ in 0..n {
            let (direction, texel) = sky.sample(rng.random());
            if texel == sun {
                suns += 1;
            } else {
                // Slices of equal solid angle have equal power, apart from the sun's share.
                let slice = (4.0 * (0.5 + 0.5 * f64::from(direction.z))).min(3.0) as usize;
                blocks[4 * slice + 4 * (texel % width) / width] += 1;
            }
        }
        let within = |count: i32, share: f64| {
            let (want, sd) = (share * f64::from(n), (f64::from(n) * share * (1.0 - share)).sqrt());
            assert!((f64::from(count) - want).abs() < 5.0 * sd, "{count}, want {want} +- {sd}");
        };
        within(suns, 0.5);
        blocks.into_iter().for_each(|count| within(count, 0.5 / 16.0));
    }

    /// A sky's texel that the camera sees directly shows the texel's color.
    #[test]
    fn skies_show_the_colors_of_their_picture() {
        for srgb in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, 0.3, 0.3], [20.0, 3.0, 0.01]] {
            let sky = Environment::picture(1, vec![srgb]).unwrap();
            let mut xyz = [0.0; 3];
            let n = 4000;
            for k in 0..n {
                let lambda = crate::spectrum::lambda_at((k as f32 + 0.5) / n as f32);
                let part = crate::spectrum::xyz([lambda; 4], sky.radiance(0, [lambda; 4]));
                (0..3).for_each(|c| xyz[c] += f64::from(part[c]) / f64::from(n));
            }
            let back = color::linear_srgb_of_xyz(xyz);
            let largest = f64::from(srgb.into_iter().fold(0.0, f32::max));
            for c in 0..3 {
                assert!((back[c] - f64::from(srgb[c])).abs() < 5e-4 * largest, "{srgb:?}: {back:?}");
            }
        }
        assert_eq!(Environment::picture(1, vec![[0.25; 3]]).unwrap().texels, [[0.25; 3]]);
    }
}

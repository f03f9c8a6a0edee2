//! Light sources: rectangles, and an environment of equal light or from a latitude-longitude picture.

use crate::RenderError;
use crate::room::check_room;
use glam::Vec3;
use std::f32::consts::{PI, TAU};
use std::path::Path;

/// A rectangle that shines on one side, the side of `edges[0] x edges[1]`, with the same radiance into all directions.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// A corner [mm].
    pub corner: Vec3,
    /// The two edges from it [mm], at right angles.
    pub edges: [Vec3; 2],
    /// Radiance, relative to the illuminant's spectrum.
    pub radiance: f32,
}

impl Light {
    /// A square of side `size` [mm] at `center` that faces `target`.
    pub fn facing(center: Vec3, target: Vec3, size: f32, radiance: f32) -> Light {
        let normal = (target - center).normalize();
        let across = normal.any_orthonormal_vector() * size;
        let up = normal.cross(across);
        Light { corner: center - 0.5 * (across + up), edges: [across, up], radiance }
    }

    fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1]).normalize_or_zero()
    }

    fn area(&self) -> f32 {
        self.edges[0].cross(self.edges[1]).length()
    }

    /// Distance along a ray to the shining side, if it is met.
    pub(crate) fn hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let cos = -self.normal().dot(direction);
        if cos <= 1e-9 {
            return None;
        }
        let t = (origin - self.corner).dot(self.normal()) / cos;
        let local = origin + direction * t - self.corner;
        let inside = self.edges.iter().all(|e| (0.0..=1.0).contains(&(local.dot(*e) / e.length_squared())));
        (t > 0.0 && inside).then_some(t)
    }

    /// Density [1/sr] of sampling, from `origin`, the direction in which the light is `t` away.
    pub(crate) fn pdf(&self, direction: Vec3, t: f32) -> f32 {
        t * t / (self.area() * -self.normal().dot(direction)).max(1e-20)
    }

    /// Direction to a point of the light by two uniform numbers, and the distance.
    pub(crate) fn sample(&self, origin: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        let to = self.corner + self.edges[0] * u[0] + self.edges[1] * u[1] - origin;
        let t = to.length();
        (to / t.max(1e-20), t)
    }
}

/// Most texels of an environment: 16384 x 8192.
const MOST_TEXELS: u64 = 1 << 27;
/// Bytes that a chunk of an EXR takes at least: 8 in the table of offsets, 4 of its place, 4 of its size.
const CHUNK_BYTES: u64 = 16;
/// Bytes a texel that an environment takes: the colors, twice while they are read, and the running sums.
const TEXEL_BYTES: u64 = 28;

/// Light from infinitely far: radiance over the sphere, z up, relative to the illuminant's spectrum. A picture's colors become a scale of three broad bands.
#[derive(Clone, Debug)]
pub struct Environment {
    width: usize,
    height: usize,
    /// Linear red, green, blue of each texel, rows from the zenith down.
    texels: Vec<[f32; 3]>,
    /// Running sums for sampling: of rows, and within each row.
    rows: Vec<f32>,
    columns: Vec<f32>,
}

impl Environment {
    /// The same radiance from everywhere.
    pub fn constant(radiance: f32) -> Environment {
        Environment::new(1, 1, vec![[radiance; 3]])
    }

    /// The same radiance from everywhere above the horizon, none from below.
    pub fn above(radiance: f32) -> Environment {
        Environment::new(1, 2, vec![[radiance; 3], [0.0; 3]])
    }

    /// A latitude-longitude picture in OpenEXR, times `scale`.
    ///
    /// # Errors
    /// [`RenderError::Picture`] when it cannot be read, has more than 134 M texels, or holds numbers that are not finite or below 0; [`RenderError::TooLarge`].
    pub fn load(path: &Path, scale: f32) -> Result<Environment, RenderError> {
        use exr::prelude::*;
        let name = path.display().to_string();
        let bad = |what: String| RenderError::Picture { file: name.clone(), what };
        check_header(path)?;
        let image = read_first_rgba_layer_from_file(
            path,
            |size, _| (size.width(), vec![[0.0f32; 3]; size.width() * size.height()]),
            |(width, texels), at, (r, g, b, _): (f32, f32, f32, f32)| texels[at.y() * *width + at.x()] = [r, g, b],
        )
        .map_err(|e| bad(e.to_string()))?;
        let (width, mut texels) = image.layer_data.channel_data.pixels;
        if texels.iter().flatten().any(|v| !v.is_finite() || *v < 0.0) {
            return Err(bad("radiances must be finite and not negative".into()));
        }
        texels.iter_mut().flatten().for_each(|v| *v *= scale);
        Ok(Environment::new(width, texels.len() / width.max(1), texels))
    }

    fn new(width: usize, height: usize, texels: Vec<[f32; 3]>) -> Environment {
        let (mut rows, mut columns) = (Vec::with_capacity(height), Vec::with_capacity(width * height));
        let mut all = 0.0;
        for j in 0..height {
            let sin = (PI * (j as f32 + 0.5) / height as f32).sin();
            let mut sum = 0.0;
            for texel in &texels[j * width..(j + 1) * width] {
                sum += texel.iter().sum::<f32>() * sin;
                columns.push(sum);
            }
            all += sum;
            rows.push(all);
        }
        Environment { width, height, texels, rows, columns }
    }

    /// Whether it is dark.
    pub(crate) fn is_dark(&self) -> bool {
        self.rows.last().is_none_or(|all| *all <= 0.0)
    }

    fn texel(&self, direction: Vec3) -> usize {
        let v = direction.z.clamp(-1.0, 1.0).acos() / PI;
        let u = direction.y.atan2(direction.x) / TAU;
        let i = ((u - u.floor()) * self.width as f32) as usize;
        let j = (v * self.height as f32) as usize;
        j.min(self.height - 1) * self.width + i.min(self.width - 1)
    }

    /// Radiance from `direction` at wavelengths [um].
    pub(crate) fn radiance<const N: usize>(&self, direction: Vec3, lambda_um: [f32; N]) -> [f32; N] {
        let [r, g, b] = self.texels[self.texel(direction)];
        lambda_um.map(|l| {
            if l > 0.59 {
                r
            } else if l > 0.49 {
                g
            } else {
                b
            }
        })
    }

    /// Density [1/sr] of sampling `direction`.
    pub(crate) fn pdf(&self, direction: Vec3) -> f32 {
        let at = self.texel(direction);
        let (j, all) = (at / self.width, self.rows[self.height - 1]);
        let sin = (PI * (j as f32 + 0.5) / self.height as f32).sin();
        let share = self.texels[at].iter().sum::<f32>() * sin / all.max(1e-30);
        // The texel's exact solid angle.
        let edge = |k: usize| (PI * k as f32 / self.height as f32).cos();
        share / ((edge(j) - edge(j + 1)) * TAU / self.width as f32)
    }

    /// A direction by two uniform numbers.
    pub(crate) fn sample(&self, u: [f32; 2]) -> Vec3 {
        let target = u[0] * self.rows[self.height - 1];
        let j = self.rows.partition_point(|s| *s <= target).min(self.height - 1);
        let before = if j == 0 { 0.0 } else { self.rows[j - 1] };
        let v = ((target - before) / (self.rows[j] - before).max(1e-30)).clamp(0.0, 1.0);
        let row = &self.columns[j * self.width..(j + 1) * self.width];
        let target = u[1] * row[self.width - 1];
        let i = row.partition_point(|s| *s <= target).min(self.width - 1);
        let before = if i == 0 { 0.0 } else { row[i - 1] };
        let w = ((target - before) / (row[i] - before).max(1e-30)).clamp(0.0, 1.0);
        let edge = |k: usize| (PI * k as f32 / self.height as f32).cos();
        let z = edge(j) + v * (edge(j + 1) - edge(j));
        let (sin, phi) = ((1.0 - z * z).max(0.0).sqrt(), TAU * (i as f32 + w) / self.width as f32);
        Vec3::new(sin * phi.cos(), sin * phi.sin(), z)
    }
}

/// Refuses an EXR by its header alone, before anything is allocated by the sizes that it claims.
fn check_header(path: &Path) -> Result<(), RenderError> {
    let name = path.display().to_string();
    let bad = |what: String| RenderError::Picture { file: name.clone(), what };
    let io = |source| RenderError::Io { file: name.clone(), source };
    let about = std::fs::metadata(path).map_err(io)?;
    if !about.is_file() {
        return Err(bad("no regular file; give an EXR".into()));
    }
    let meta = exr::meta::MetaData::read_from_file(path, false).map_err(|e| bad(e.to_string()))?;
    for header in &meta.headers {
        let [w, h] = [header.layer_size.x() as u64, header.layer_size.y() as u64];
        let texels = w.saturating_mul(h);
        if texels > MOST_TEXELS {
            return Err(bad(format!("{w} x {h} texels; use a picture of at most {MOST_TEXELS}")));
        }
        // Every chunk has its place in a table and a head of its own.
        let least = (header.chunk_count as u64).saturating_mul(CHUNK_BYTES);
        if least > about.len() {
            return Err(bad(format!("{w} x {h} texels do not fit into {} bytes; the file is cut off", about.len())));
        }
        let sample = header.channels.bytes_per_pixel as u64 + TEXEL_BYTES;
        check_room(&format!("{name}: a sky of {w} x {h} texels"), texels.saturating_mul(sample))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn environments_sample_what_their_pdf_says() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let texels: Vec<[f32; 3]> = (0..8 * 4).map(|_| rng.random()).collect();
        let env = Environment::new(8, 4, texels);
        // The mean of radiance / pdf is the integral of the radiance; the mean of 1 / pdf is 4 pi.
        let n = 200_000;
        let (mut sum, mut area, mut squares) = (0.0f64, 0.0f64, 0.0f64);
        for _ in 0..n {
            let w = env.sample([rng.random(), rng.random()]);
            let inverse = 1.0 / f64::from(env.pdf(w));
            area += inverse;
            squares += inverse * inverse;
            sum += f64::from(env.radiance(w, [0.55f32])[0]) * inverse;
        }
        let (mean, n) = (area / n as f64, n as f64);
        let se = ((squares / n - mean * mean) / n).sqrt();
        assert!((mean - 4.0 * std::f64::consts::PI).abs() < 5.0 * se, "{mean}");
        let want: f64 = (0..200 * 400)
            .map(|k| {
                let (theta, phi) = (PI * ((k / 400) as f32 + 0.5) / 200.0, TAU * ((k % 400) as f32 + 0.5) / 400.0);
                let w = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                f64::from(env.radiance(w, [0.55f32])[0] * theta.sin() * PI / 200.0 * TAU / 400.0)
            })
            .sum();
        assert!((sum / n / want - 1.0).abs() < 0.01, "{} {want}", sum / n);
    }

    #[test]
    fn rectangles_sample_what_their_pdf_says() {
        let light = Light::facing(Vec3::new(3.0, 1.0, 4.0), Vec3::ZERO, 2.0, 1.0);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        let (mut sampled, mut seen) = (0.0f64, 0.0f64);
        let n = 200_000;
        for _ in 0..n {
            let (w, t) = light.sample(Vec3::ZERO, [rng.random(), rng.random()]);
            assert!((light.hit(Vec3::ZERO, w).unwrap() - t).abs() < 1e-3);
            sampled += 1.0 / f64::from(light.pdf(w, t));
            let z = 2.0 * rng.random::<f32>() - 1.0;
            let phi = TAU * rng.random::<f32>();
            let sin = (1.0 - z * z).sqrt();
            let anywhere = Vec3::new(sin * phi.cos(), sin * phi.sin(), z);
            seen += light.hit(Vec3::ZERO, anywhere).map_or(0.0, |_| 4.0 * std::f64::consts::PI);
        }
        // Both estimate the solid angle.
        let (sampled, seen) = (sampled / n as f64, seen / n as f64);
        assert!(
            (sampled - seen).abs() < 5.0 * (seen * 4.0 * std::f64::consts::PI / n as f64).sqrt(),
            "{sampled} {seen}"
        );
    }
}

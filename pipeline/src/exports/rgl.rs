//! Writes the reflection of a cloth's face in the format of Dupuy and Jakob, "An Adaptive Parameterization
//! for Efficient Material Acquisition and Rendering" (ACM TOG 37(6), 2018).
//!
//! For light from omega_i and a direction with half vector m, a reader computes `u = (sqrt(2 theta_m / pi),
//! (phi_m + pi) / 2 pi)` and the point of the unit square that the warp by `vndf` maps to u; it returns the
//! spectrum at that point times `ndf(u) / (4 sigma)`, which is the BSDF times the cosine. Here vndf is
//! uniform, so that the warp is the identity, ndf is 1 and sigma 1/4: the spectra contain f itself, indexed
//! by half vectors. The light of a cylinder concentrates at half vectors perpendicular to it for every
//! omega_i, so its position does not change between the nodes of omega_i. Readers sample by `luminance`: f
//! times `|d omega / du|`. Renderers of RGB read files with colors, spectral ones files with spectra.

use super::Format;
use super::mean::{Bands, MeanCloth, NODES, Spectrum, lambda_um};
use super::tensor_file::{Field, bytes};
use crate::error::Error;
use crate::run::Run;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Numbers of nodes of a file.
#[derive(Clone, Copy, Debug)]
pub struct RglSize {
    /// Number of nodes of the azimuth of omega_i over a full turn.
    pub phi_i: usize,
    /// Number of nodes of theta_i.
    pub theta_i: usize,
    /// Numbers of nodes of a half vector's theta and phi; readers require both to be equal.
    pub half: [usize; 2],
}

/// Largest theta_i [rad].
const LAST_THETA: f64 = 86.0 * PI / 180.0;
/// Every `NODE_STEP`-th node of the spectrum is written to the file.
const NODE_STEP: usize = 5;

/// A file and its energies.
pub struct Rgl {
    /// Bytes of the file.
    pub bytes: Vec<u8>,
    /// Largest sum over omega_i of the file's reflected light and the cloth's transmitted light.
    pub largest_total: f64,
    /// Largest relative change of a view's light when it was scaled to the cloth's.
    pub energy_change: f64,
}

/// Values for one direction omega_i.
struct View {
    rgb: Vec<[f32; 3]>,
    spectra: Vec<[f32; (NODES - 1) / NODE_STEP + 1]>,
    luminance: Vec<f32>,
    total: f64,
    change: f64,
}

/// Numbers of directions over which reflected light is summed: rows, denser towards the plane, and columns.
const SUM: [usize; 2] = [64, 96];

/// Visible light from `wi` that the face reflects.
fn reflected(cloth: &MeanCloth, wi: [f32; 3], bands: &Bands) -> f64 {
    let (mut w, mut omega) = (Vec::new(), Vec::new());
    for row in 0..SUM[0] {
        let t = (row as f64 + 0.5) / SUM[0] as f64;
        let (z, solid_angle) = (t * t, 2.0 * t * TAU / (SUM[0] * SUM[1]) as f64);
        let across = (1.0 - z * z).sqrt();
        for column in 0..SUM[1] {
            let (sin, cos) = (TAU * (column as f64 + 0.5) / SUM[1] as f64).sin_cos();
            w.push([across * cos, across * sin, z].map(|v| v as f32));
            omega.push(solid_angle);
        }
    }
    let mut f = vec![Spectrum::ZERO; w.len()];
    cloth.f(wi, &w, &mut f);
    f.iter().zip(omega).map(|(f, omega)| omega * bands.visible(f)).sum()
}

/// Computes the file of a cloth.
///
/// # Errors
/// [`Error::Interrupted`] if the run was stopped.
pub fn rgl(cloth: &MeanCloth, name: &str, size: RglSize, is_spectral: bool, run: &Run<'_>) -> Result<Rgl, Error> {
    let [columns, rows] = size.half;
    let theta_i: Vec<f64> = (0..size.theta_i).map(|k| LAST_THETA * k as f64 / (size.theta_i - 1) as f64).collect();
    let phi_i: Vec<f64> = (0..size.phi_i).map(|k| -PI + TAU * k as f64 / (size.phi_i - 1) as f64).collect();
    let bands = Bands::new();
    // theta_m of a column and phi_m of a row of the square.
    let theta_m = |x: usize| FRAC_PI_2 * (x as f64 / (columns - 1) as f64).powi(2);
    let phi_m = |y: usize| -PI + TAU * y as f64 / (rows - 1) as f64;
    let view = |number: usize| -> Result<View, Error> {
        run.check_stop()?;
        let wi = direction(theta_i[number % size.theta_i], phi_i[number / size.theta_i]);
        let (mut at, mut w, mut jacobian) = (Vec::new(), Vec::new(), Vec::new());
        for y in 0..rows {
            for x in 0..columns {
                let m = direction(theta_m(x), phi_m(y));
                let cos = (0..3).map(|k| wi[k] * m[k]).sum::<f64>();
                let wo: [f64; 3] = std::array::from_fn(|k| 2.0 * cos * m[k] - wi[k]);
                if cos > 0.0 && wo[2] > 1e-4 {
                    at.push(y * columns + x);
                    w.push(wo.map(|v| v as f32));
                    let u = x as f64 / (columns - 1) as f64;
                    jacobian.push((2.0 * PI * PI * u * theta_m(x).sin()).max(1e-6) * 4.0 * cos);
                }
            }
        }
        let mut f = vec![Spectrum::ZERO; w.len()];
        cloth.f(wi.map(|v| v as f32), &w, &mut f);
        let count = rows * columns;
        let mut view = View {
            rgb: vec![[0.0; 3]; count],
            spectra: vec![[0.0; (NODES - 1) / NODE_STEP + 1]; count],
            luminance: vec![0.0; count],
            total: 0.0,
            change: 0.0,
        };
        for ((at, f), jacobian) in at.into_iter().zip(&f).zip(jacobian) {
            view.rgb[at] = bands.rgb_in_gamut(f).map(|v| v as f32);
            view.spectra[at] = std::array::from_fn(|k| f.visible[NODE_STEP * k] as f32);
            view.luminance[at] = (bands.visible(f) * jacobian).max(0.0) as f32;
        }
        // The file is linear between its nodes: its light is scaled to that of the cloth.
        let wi = wi.map(|v| v as f32);
        let (own, wanted) = (energy_of(&view.luminance, size.half), reflected(cloth, wi, &bands));
        let scale = if own > 1e-6 { wanted / own } else { 1.0 };
        view.change = (scale - 1.0).abs();
        view.rgb.as_flattened_mut().iter_mut().for_each(|v| *v *= scale as f32);
        view.spectra.as_flattened_mut().iter_mut().for_each(|v| *v *= scale as f32);
        view.luminance.iter_mut().for_each(|v| *v *= scale as f32);
        let (scattered, straight) = cloth.energy(wi);
        view.total = energy_of(&view.luminance, size.half) + bands.visible(&scattered) - wanted + straight;
        Ok(view)
    };
    let views = (0..size.theta_i * size.phi_i).into_par_iter().map(view).collect::<Result<Vec<_>, Error>>()?;
    // Channels precede the coordinates of the square.
    let planes = |channels: usize, of: &dyn Fn(&View, usize, usize) -> f32| -> Vec<f32> {
        let each = |view: &View| -> Vec<f32> {
            (0..channels)
                .flat_map(|c| (0..rows * columns).map(move |at| (c, at)))
                .map(|(c, at)| of(view, c, at))
                .collect()
        };
        views.iter().flat_map(each).collect()
    };
    let channels = (NODES - 1) / NODE_STEP + 1;
    let single = |v: &[f64]| v.iter().map(|v| *v as f32).collect::<Vec<f32>>();
    let (p, t) = (size.phi_i, size.theta_i);
    let mut fields = vec![
        Field::bytes("description", format!("{name} ({})", Format::Rgl.mark()).into_bytes()),
        Field::bytes("jacobian", vec![1u8]),
        Field::f32("phi_i", &[p], single(&phi_i)),
        Field::f32("theta_i", &[t], single(&theta_i)),
        Field::f32("ndf", &[2, 2], vec![1.0; 4]),
        Field::f32("sigma", &[2, 2], vec![0.25; 4]),
        Field::f32("vndf", &[p, t, 2, 2], vec![1.0; 4 * p * t]),
        Field::f32("luminance", &[p, t, rows, columns], planes(1, &|view, _, at| view.luminance[at])),
    ];
    if is_spectral {
        let wavelengths: Vec<f32> = (0..channels).map(|k| (1e3 * lambda_um(NODE_STEP * k)) as f32).collect();
        let spectra = planes(channels, &|view, c, at| view.spectra[at][c]);
        fields.push(Field::f32("wavelengths", &[channels], wavelengths));
        fields.push(Field::f32("spectra", &[p, t, channels, rows, columns], spectra));
    } else {
        fields.push(Field::f32("rgb", &[p, t, 3, rows, columns], planes(3, &|view, c, at| view.rgb[at][c])));
    }
    let largest = |of: fn(&View) -> f64| views.iter().map(of).fold(0.0, f64::max);
    Ok(Rgl {
        bytes: bytes(&fields),
        largest_total: largest(|view| view.total),
        energy_change: largest(|view| view.change),
    })
}

/// Light of a view from its luminance, which is linear between the nodes of half vectors.
fn energy_of(luminance: &[f32], [columns, rows]: [usize; 2]) -> f64 {
    let mean = |x: usize, y: usize| {
        let row = &luminance[y * columns..];
        let next = &luminance[(y + 1) * columns..];
        0.25 * [row[x], row[x + 1], next[x], next[x + 1]].map(f64::from).iter().sum::<f64>()
    };
    let sum: f64 = (0..rows - 1).flat_map(|y| (0..columns - 1).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).sum();
    sum / ((rows - 1) * (columns - 1)) as f64
}

fn direction(theta: f64, phi: f64) -> [f64; 3] {
    let ((s, z), (sin, cos)) = (theta.sin_cos(), phi.sin_cos());
    [s * cos, s * sin, z]
}

//! The albedo of a ply as a function of the absorption of its fibers, from the energies of its model.

use super::model::PlyModel;
use crate::color::AlbedoCurve;

impl AlbedoCurve {
    /// The curve under diffuse light: the scattered share of the light that hits fibers, averaged uniformly
    /// over offsets and with the weight cos^2 theta_i over latitudes, the projected solid angle of uniform
    /// light about a thread. The last node represents all latitudes beyond it.
    pub fn diffuse(model: &PlyModel) -> AlbedoCurve {
        let d = model.data();
        let (m, last) = (d.theta_i.len(), d.theta_i[d.theta_i.len() - 1]);
        let primitive = |theta: f64| 0.5 * theta + 0.25 * (2.0 * theta).sin();
        let step = last / (m - 1) as f64;
        let weight = |row: usize| {
            let low = if row == 0 { 0.0 } else { step * (row as f64 - 0.5) };
            let high = if row + 1 == m { std::f64::consts::FRAC_PI_2 } else { step * (row as f64 + 0.5) };
            primitive(high) - primitive(low)
        };
        AlbedoCurve::from_model(model, &weight)
    }

    /// The curve under light of one latitude [rad], averaged uniformly over offsets. It is linear between the
    /// nodes and constant beyond the last.
    pub fn at(model: &PlyModel, theta_i: f64) -> AlbedoCurve {
        let d = model.data();
        let (m, last) = (d.theta_i.len(), d.theta_i[d.theta_i.len() - 1]);
        let x = (theta_i.abs() / last * (m - 1) as f64).max(0.0).min((m - 1) as f64);
        AlbedoCurve::from_model(model, &|row| (1.0 - (x - row as f64).abs()).max(0.0))
    }

    fn from_model(model: &PlyModel, weight: &dyn Fn(usize) -> f64) -> AlbedoCurve {
        let d = model.data();
        let (theta_i, h_um, j) = (&d.theta_i, &d.h_um, d.path_um.len());
        let h = h_um.len();
        let (mut constant, mut energy, mut hit) = (0.0, vec![0.0; j], 0.0);
        for row in 0..d.theta_i.len() {
            for column in 0..h {
                let w = weight(row) * if column == 0 || column + 1 == h { 0.5 } else { 1.0 };
                if w == 0.0 {
                    continue;
                }
                let at = d.energies.at(theta_i[row], h_um[column]);
                hit += w * (1.0 - at.r_d);
                constant += w * at.refl;
                for (sum, e) in energy.iter_mut().zip(&at.high) {
                    *sum += w * e;
                }
            }
        }
        // A model whose fibers the light never hits is black.
        let scale = if hit > 0.0 { 1.0 / hit } else { 0.0 };
        energy.iter_mut().for_each(|e| *e *= scale);
        AlbedoCurve::of_paths(constant * scale, d.path_um.clone(), energy)
    }
}

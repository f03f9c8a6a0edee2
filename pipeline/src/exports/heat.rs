//! Heat transfer through a cloth, with the quantities from which LBNL WINDOW computes U and SHGC.
//!
//! Quantities in the spec are used unchanged. The others are estimated: the covered area emits like its
//! fibers, the fraction of light that misses all fibers is the transmittance near 10 um, and air flows
//! through the area where a line along the normal misses all plies. Scattering and transmission of the fibers
//! near 10 um are neglected.

use super::matrix::Matrix;
use super::mean::MeanCloth;
use crate::error::Error;
use plywave::cloth::geometry::start;
use plywave::cloth::{ClothData, LineHits};
use plywave::spec::{FiberSpec, YarnSpec};
use plywave_textile::ClothSpec;
use std::f64::consts::PI;

/// Thermal conductivity of polymer shades [W/(m K)].
const CONDUCTIVITY: f64 = 0.15;
/// Emissivity of polymers, cellulose, proteins and glass, per covered area.
const EMISSIVITY: f64 = 0.9;
/// Emissivity of clean metals.
const METAL_EMISSIVITY: f64 = 0.05;
/// Number of lines along the normal.
const LINES: usize = 4096;

/// Thermal quantities of a cloth.
#[derive(Clone, Debug, PartialEq)]
pub struct Heat {
    /// Thickness [um].
    pub thickness_um: f64,
    /// Conductivity [W/(m K)].
    pub conductivity: f64,
    /// Hemispherical emissivities of face and back.
    pub emissivity: [f64; 2],
    /// Hemispherical transmittance near 10 um.
    pub ir_transmittance: f64,
    /// Fraction of the area through which air flows.
    pub permeability: f64,
    /// Note that lists the assumed quantities.
    pub note: String,
}

impl Heat {
    /// Thermal quantities of a cloth with this matrix.
    ///
    /// # Errors
    /// [`Error::Runtime`] if the spec inside the cloth file cannot be read.
    pub fn new(data: &ClothData, cloth: &MeanCloth, matrix: &Matrix) -> Result<Heat, Error> {
        let spec = ClothSpec::parse(&data.spec_text, &format!("{} (its spec)", data.name))?;
        let thermal = spec.thermal.unwrap_or_default();
        let fibers = emissivities(data)?;
        let normal = Normal::new(cloth);
        let of_spec = [thermal.emissivity_front, thermal.emissivity_back];
        let largest = of_spec.iter().flatten().copied().fold(0.0, f64::max);
        let ir_transmittance = thermal.ir_transmittance.unwrap_or_else(|| straight(matrix).min(1.0 - largest));
        let emissivity = [0, 1].map(|side| {
            let of_fibers: f64 = normal.shares[side].iter().zip(&fibers).map(|(share, e)| share * e).sum();
            of_spec[side].unwrap_or(of_fibers * (1.0 - ir_transmittance))
        });
        let assumed: Vec<&str> = [
            ("the conductivity", thermal.conductivity_w_per_m_k.is_none()),
            ("the emissivity of the face", thermal.emissivity_front.is_none()),
            ("the emissivity of the back", thermal.emissivity_back.is_none()),
            ("the infrared transmittance", thermal.ir_transmittance.is_none()),
            ("the permeability", thermal.permeability.is_none()),
        ]
        .into_iter()
        .filter_map(|(name, is_assumed)| is_assumed.then_some(name))
        .collect();
        Ok(Heat {
            thickness_um: thermal
                .thickness_um
                .unwrap_or_else(|| 2.0 * f64::from(cloth.points().lines().half_thickness_um())),
            conductivity: thermal.conductivity_w_per_m_k.unwrap_or(CONDUCTIVITY),
            emissivity,
            ir_transmittance,
            permeability: thermal.permeability.unwrap_or(normal.open),
            note: match assumed.is_empty() {
                true => "Heat: all thermal numbers are those of the cloth spec.".into(),
                false => format!(
                    "Heat: {} {} not in the cloth spec ([thermal]) and follow from usual fibers and the open area of the cloth.",
                    listed(&assumed),
                    if assumed.len() == 1 { "is" } else { "are" }
                ),
            },
        })
    }

    /// The quantities as facts.
    pub fn facts(&self) -> [(&'static str, f64); 6] {
        [
            ("thickness_um", self.thickness_um),
            ("conductivity_w_per_m_k", self.conductivity),
            ("emissivity_front", self.emissivity[0]),
            ("emissivity_back", self.emissivity[1]),
            ("ir_transmittance", self.ir_transmittance),
            ("permeability", self.permeability),
        ]
    }
}

/// A list of names as part of a sentence.
fn listed(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).into(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Fraction of light uniform over the hemisphere that misses all fibers.
fn straight(matrix: &Matrix) -> f64 {
    let of = |side: &Vec<f64>| {
        let each = side.iter().enumerate();
        each.map(|(patch, straight)| straight * matrix.basis.projected_solid_angle(patch) / PI).sum::<f64>()
    };
    (0.5 * matrix.straight.iter().map(of).sum::<f64>()).clamp(0.0, 1.0)
}

/// Emissivity of the fibers, by kind of yarn.
fn emissivities(data: &ClothData) -> Result<Vec<f64>, Error> {
    let of_fiber = |fiber: &FiberSpec| match fiber.metal {
        Some(_) => METAL_EMISSIVITY,
        None => EMISSIVITY,
    };
    let of_yarn = |text: &str| -> Result<f64, Error> {
        let spec = YarnSpec::parse(text, "model (its spec)")?;
        let first = of_fiber(&spec.fiber);
        Ok(spec.blend.as_ref().map_or(first, |blend| first + blend.share * (of_fiber(&blend.fiber) - first)))
    };
    data.models.iter().map(|model| of_yarn(&model.data().spec_text)).collect()
}

/// Hits of lines along the normal.
struct Normal {
    /// Fraction of the lines that miss all plies.
    open: f64,
    /// `[face, back][kind]`: fractions of the kinds of yarns among the first hits.
    shares: [[f64; 2]; 2],
}

impl Normal {
    fn new(cloth: &MeanCloth) -> Normal {
        let lines = cloth.points().lines();
        let [x, y] = cloth.points().cell_um();
        let (mut open, mut counts) = (0usize, [[0usize; 2]; 2]);
        let mut hits = LineHits::default();
        for k in 0..LINES {
            let u = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3].map(|s: f64| ((k as f64 + 0.5) * s).fract());
            let at = [0, 1].map(|axis| (u[0] * x[axis] + u[1] * y[axis]) as f32);
            for (side, z) in [1.0, -1.0].into_iter().enumerate() {
                lines.hits(start(lines, at, [0.0, 0.0, z]), [0.0, 0.0, -z], &mut hits);
                match hits.as_slice().first() {
                    Some(hit) => counts[side][cloth.kind_of(hit.curve as usize).min(1)] += 1,
                    None => open += 1 - side,
                }
            }
        }
        let share = |counts: [usize; 2]| counts.map(|n| n as f64 / counts.iter().sum::<usize>().max(1) as f64);
        Normal { open: open as f64 / LINES as f64, shares: counts.map(share) }
    }
}

//! Descriptions of yarns in words.

use crate::report::{counted, number};
use plywave::spec::{FiberSpec, Shape, YarnSpec};

/// One line on the fibers and the ply of a spec.
pub fn yarn_line(spec: &YarnSpec) -> String {
    let ply = match spec.ply.radii_um {
        Some([a, b]) => format!("elliptical ply of {} x {} um", number(a), number(b)),
        None => format!("ply of radius {} um", number(spec.ply.radius_um.unwrap_or(0.0))),
    };
    let twist = match spec.ply.fiber_pitch_um {
        Some(pitch) => format!("pitch {} um {:?}", number(pitch), spec.ply.handedness),
        None => "no twist".into(),
    };
    let yarn = match (spec.yarn.plies, spec.yarn.ply_pitch_um) {
        (1, _) => String::new(),
        (plies, None) => format!("; yarn of {plies} parallel plies"),
        (plies, Some(pitch)) => {
            format!("; yarn of {plies} plies, pitch {} um {:?}", number(pitch), spec.yarn.handedness)
        }
    };
    let other = spec
        .blend
        .as_ref()
        .map_or(String::new(), |blend| format!("; {} of them {}", number(blend.share), fiber_line(&blend.fiber)));
    format!(
        "{}, {}{other}; {ply}, {twist}{yarn}",
        counted(spec.ply.fibers as u64, "fiber", "fibers"),
        fiber_line(&spec.fiber)
    )
}

/// A fiber in some words.
fn fiber_line(fiber: &FiberSpec) -> String {
    let shape = match &fiber.shape {
        Shape::Circle { radius_um } => format!("circle of radius {} um", number(*radius_um)),
        Shape::HollowCircle { radius_um, lumen, .. } => {
            format!("hollow circle of radius {} um, core {}", number(*radius_um), number(*lumen))
        }
        Shape::Ellipse { a_um, b_um } => format!("ellipse of {} x {} um", number(*a_um), number(*b_um)),
        Shape::Kidney { a_um, b_um, lumen, .. } => {
            let hollow = if *lumen > 0.0 { "hollow " } else { "" };
            format!("{hollow}kidney of {} x {} um", number(*a_um), number(*b_um))
        }
        Shape::RoundedTriangle { radius_um, .. } => format!("rounded triangle of radius {} um", number(*radius_um)),
        Shape::Stone { radius_um, .. } => format!("stone of radius {} um", number(*radius_um)),
        Shape::Trilobal { radius_um, .. } => format!("trilobal of radius {} um", number(*radius_um)),
        Shape::Serrated { radius_um, .. } => format!("serrated of radius {} um", number(*radius_um)),
        Shape::Polygon { .. } => "polygon".to_string(),
    };
    let index = match (fiber.metal, fiber.kappa) {
        (Some(metal), _) => format!("{metal:?}").to_lowercase(),
        (None, Some(kappa)) => format!("eta {}, kappa {}", number(fiber.eta), number(kappa)),
        (None, None) => format!("eta {}", number(fiber.eta)),
    };
    let dispersion = fiber.dispersion_um2.map_or(String::new(), |b| format!(", dispersion {} um2", number(b)));
    format!("{shape}, {index}{dispersion}, alpha_fiber {}", number(fiber.alpha_fiber))
}

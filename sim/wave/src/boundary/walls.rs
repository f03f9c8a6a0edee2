//! Walls between media: outlines of bodies and lumens, with nodes and the media on both sides, and a check
//! that no two cross.

use crate::boundary::kernel::Medium;
use crate::boundary::vicinity::{steepness, width_nodes};
use crate::scene::curve::{Curve, Resolution};
use crate::{Body, C64, Shape, Wave, WaveError};
use std::f64::consts::TAU;

/// A wall, its range of nodes and its media.
pub(crate) struct Wall {
    /// The outline and its nodes.
    pub curve: Curve,
    /// Index of its first node among all.
    pub first: usize,
    /// Media (of [`BoundarySystem::media`]) on both sides.
    pub outside: usize,
    pub inside: usize,
    /// Its name in errors.
    pub name: String,
}

/// Media and walls of bodies, each with the nodes for its wavelength.
pub(crate) fn trace_walls(
    bodies: &[Body],
    wave: &Wave,
    resolution: &Resolution,
) -> Result<(Vec<Medium>, Vec<Wall>), WaveError> {
    let mut media = vec![Medium { kappa: C64::new(wave.k_rho(), 0.0), eps: C64::ONE }];
    let mut walls = Vec::new();
    for (index, top) in bodies.iter().enumerate() {
        let mut outside = 0;
        let mut name = format!("fiber[{index}]");
        let mut next = Some(top);
        while let Some(body) = next {
            if !(body.eta > 0.0 && body.eta.is_finite()) {
                return Err(WaveError::Invalid {
                    key: format!("{name}.eta"),
                    value: body.eta.to_string(),
                    hint: "use a positive index".into(),
                });
            }
            if !(body.kappa >= 0.0 && body.kappa.is_finite()) {
                return Err(WaveError::Invalid {
                    key: format!("{name}.kappa"),
                    value: body.kappa.to_string(),
                    hint: "use 0 or more (absorption)".into(),
                });
            }
            let inside = media.len();
            media.push(Medium { kappa: wave.k_rho_in(body.index()), eps: body.index() * body.index() });
            let curve = trace(body, wave, [media[outside], media[inside]], resolution, &name)?;
            walls.push(Wall { curve, first: 0, outside, inside, name: name.clone() });
            outside = inside;
            name.push_str(".lumen");
            next = body.lumen.as_deref();
        }
    }
    Ok((media, walls))
}

/// A wall with the nodes for the waves along it: those of both media, and on metals the surface wave,
/// `beta^2 = k_0^2 eps_o eps_i / (eps_o + eps_i) - k_z^2`.
///
/// Waves inside need no nodes if they decay before they cross the body, and within the window around a target
/// ([`vicinity`](crate::boundary::vicinity)) wherever the nodes do not resolve them. At the wall they are
/// then as smooth as their excitation, except at the joints of polygons.
fn trace(
    body: &Body,
    wave: &Wave,
    [outside, inside]: [Medium; 2],
    resolution: &Resolution,
    name: &str,
) -> Result<Curve, WaveError> {
    let square = outside.eps * inside.eps / (outside.eps + inside.eps) * wave.k0().powi(2) - wave.kz().powi(2);
    let bound = if outside.eps.re * inside.eps.re < 0.0 { square.norm().sqrt() } else { 0.0 };
    let along = outside.kappa.norm().max(bound);
    let every = along.max(inside.kappa.norm());
    let tolerance = 10.0 * (-resolution.logarithm).exp();
    let per_wavelength = match body.shape {
        Shape::Circle { .. } | Shape::Ellipse { .. } => resolution.per_wavelength_ellipse,
        _ => resolution.per_wavelength,
    };
    // The longest step that resolves the waves, and the shortest one whose window contains them.
    let resolving_um = TAU / (per_wavelength * inside.kappa.norm());
    let dead_um = steepness(tolerance) / inside.kappa.im;
    let jointed = matches!(body.shape, Shape::Polygon { .. });
    if resolution.skin && !jointed && body.lumen.is_none() && dead_um <= width_nodes(tolerance) * resolving_um {
        let curve = Curve::new(body, resolution, TAU / along, name)?;
        if dead_um < curve.thickness_um() {
            return Ok(curve);
        }
    }
    Curve::new(body, resolution, TAU / every, name)
}

/// Refuses walls that cross: a node of one on the wrong side of another.
pub(crate) fn check_overlap(walls: &[Wall]) -> Result<(), WaveError> {
    for (j, a) in walls.iter().enumerate() {
        for b in &walls[j + 1..] {
            // b inside of a, or both beside each other with overlapping boxes.
            let nested = b.outside == a.inside;
            if !nested && (b.outside != a.outside || apart(a, b)) {
                continue;
            }
            let crosses = b.curve.nodes.iter().any(|p| encloses(&a.curve, p.at) != nested)
                || a.curve.nodes.iter().any(|p| encloses(&b.curve, p.at));
            if crosses {
                return Err(WaveError::Overlap { first: a.name.clone(), second: b.name.clone() });
            }
        }
    }
    Ok(())
}

/// Whether the boxes of two walls are apart.
fn apart(a: &Wall, b: &Wall) -> bool {
    let side = |w: &Wall, k: usize| {
        w.curve.nodes.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.at[k]), h.max(p.at[k])))
    };
    (0..2).any(|k| {
        let ((al, ah), (bl, bh)) = (side(a, k), side(b, k));
        al > bh || bl > ah
    })
}

/// Whether the polygon of a wall's nodes encloses a point.
fn encloses(curve: &Curve, p: [f64; 2]) -> bool {
    let mut inside = false;
    let mut last = curve.nodes[curve.nodes.len() - 1].at;
    for node in &curve.nodes {
        let this = node.at;
        if (this[1] > p[1]) != (last[1] > p[1])
            && p[0] < (last[0] - this[0]) * (p[1] - this[1]) / (last[1] - this[1]) + this[0]
        {
            inside = !inside;
        }
        last = this;
    }
    inside
}

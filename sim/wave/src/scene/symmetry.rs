//! Symmetry of a body's node set, and the reduction of the linear system by it.
//!
//! A rigid map that takes the walls to themselves and nodes to nodes, and fixes none, commutes with the
//! boundary equations when it acts on densities by `(U u)(x) = s u(map^-1 x)`: s = -1 for the axial
//! quantities (h, Q) under mirrors, else 1. For an abelian group of such maps of order g with characters chi,
//! densities with `U_gamma u = chi(gamma) u` are known from one node per orbit,
//! `u(gamma r) = s conj(chi(gamma)) u(r)`, and the system decomposes into g blocks of 1/g of its size:
//! `M_chi(r, r') = sum_gamma s conj(chi(gamma)) M(r, gamma r')`.

use crate::C64;
use std::f64::consts::{PI, TAU};

/// Maximum order of rotations that is used.
const LARGEST_ORDER: usize = 48;
/// Agreement of mapped nodes with nodes, relative to the body's size.
const MATCH: f64 = 1e-9;

/// One map.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    /// Node -> its image.
    pub image: Vec<u32>,
    /// Whether it is a mirror: (h, Q) change sign.
    pub mirror: bool,
    /// Angle alpha [rad]: azimuths go to alpha + phi, under mirrors to alpha - phi.
    pub angle: f64,
}

impl Element {
    /// Image of a direction.
    pub(crate) fn azimuth(&self, phi: f64) -> f64 {
        self.angle + if self.mirror { -phi } else { phi }
    }
}

/// A group of maps; the first is the identity.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub elements: Vec<Element>,
    /// The point that all maps fix [um]; 0 for the identity alone.
    pub center: C64,
    /// `[chi][gamma]`.
    pub characters: Vec<Vec<C64>>,
    /// One node of each orbit, ascending.
    pub orbits: Vec<u32>,
}

/// A rigid map about a center: `z -> c + turn (z - c)`, or with the conjugate of `z - c` for a mirror.
#[derive(Clone, Copy)]
struct Map {
    center: C64,
    turn: C64,
    mirror: bool,
}

impl Map {
    fn apply(&self, z: C64) -> C64 {
        let d = z - self.center;
        self.center + self.turn * if self.mirror { d.conj() } else { d }
    }

    /// Images of all nodes, if they are nodes of the same wall; walls are consecutive nodes of `lengths`.
    fn images(&self, points: &[C64], lengths: &[usize], tolerance: f64) -> Option<Vec<u32>> {
        let mut images = Vec::with_capacity(points.len());
        let mut first = 0;
        for &n in lengths {
            let wall = &points[first..first + n];
            let target = self.apply(wall[0]);
            let start = (0..n).min_by(|&a, &b| (wall[a] - target).norm().total_cmp(&(wall[b] - target).norm()))?;
            for j in 0..n {
                // Images run along with a rotation and against a mirror.
                let image = if self.mirror { (start + n - j) % n } else { (start + j) % n };
                if image == j && (self.mirror || self.turn != C64::ONE) {
                    return None;
                }
                if (self.apply(wall[j]) - wall[image]).norm() > tolerance {
                    return None;
                }
                images.push((first + image) as u32);
            }
            first += n;
        }
        Some(images)
    }
}

impl Group {
    /// The group of the identity alone.
    pub(crate) fn trivial(nodes: usize) -> Self {
        let element = Element { image: (0..nodes as u32).collect(), mirror: false, angle: 0.0 };
        Self {
            elements: vec![element],
            center: C64::ZERO,
            characters: vec![vec![C64::ONE]],
            orbits: (0..nodes as u32).collect(),
        }
    }

    /// The largest group found for a body: rotations, or mirrors with their product. `points` are the nodes
    /// of its walls, outermost first, `lengths` the walls' counts.
    pub(crate) fn detect(points: &[C64], lengths: &[usize]) -> Self {
        let n = lengths[0];
        let outer = &points[..n];
        // The middle between opposite extremes of Fourier order 0 is not the centroid of nodes that are
        // not equidistant, but both are fixed by symmetry.
        let center = outer.iter().sum::<C64>() / n as f64;
        let size = outer.iter().map(|z| (z - center).norm()).fold(0.0, f64::max);
        let tolerance = MATCH * size;
        let images = |map: Map| {
            map.images(points, lengths, tolerance).map(|image| Element {
                image,
                mirror: map.mirror,
                angle: map.turn.arg(),
            })
        };
        let rotation = |order: usize, power: usize| Map {
            center,
            turn: if power == 0 { C64::ONE } else { C64::from_polar(1.0, TAU * power as f64 / order as f64) },
            mirror: false,
        };
        let order = (2..=LARGEST_ORDER)
            .rev()
            .find(|&m| lengths.iter().all(|l| l.is_multiple_of(m)) && images(rotation(m, 1)).is_some())
            .unwrap_or(1);
        let identity = || Element { image: (0..points.len() as u32).collect(), mirror: false, angle: 0.0 };
        if order <= 4 && order != 3 {
            // A mirror takes node 0 to an odd distance against the order of the nodes.
            let z0 = outer[0] - center;
            let mirror = (1..n).step_by(2).find_map(|c| {
                let z = outer[c] - center;
                if (z.norm() - z0.norm()).abs() > tolerance {
                    return None;
                }
                let turn = z * z0 / (z * z0).norm();
                images(Map { center, turn, mirror: true }).map(|element| (turn, element))
            });
            if let Some((turn, element)) = mirror {
                let sign = |s: i32| C64::new(s as f64, 0.0);
                if order.is_multiple_of(2) {
                    let half = images(rotation(2, 1));
                    let other = images(Map { center, turn: -turn, mirror: true });
                    if let (Some(half), Some(other)) = (half, other) {
                        let rows = [[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]];
                        let characters = rows.map(|row| row.map(sign).to_vec()).to_vec();
                        return Self::new(vec![identity(), element, other, half], center, characters);
                    }
                }
                if order == 1 {
                    let characters = vec![vec![sign(1), sign(1)], vec![sign(1), sign(-1)]];
                    return Self::new(vec![identity(), element], center, characters);
                }
            }
        }
        let elements: Option<Vec<Element>> = (0..order).map(|p| images(rotation(order, p))).collect();
        let Some(elements) = elements else { return Self::trivial(points.len()) };
        let characters = (0..order)
            .map(|chi| {
                (0..order).map(|p| C64::from_polar(1.0, 2.0 * PI * (chi * p % order) as f64 / order as f64)).collect()
            })
            .collect();
        Self::new(elements, center, characters)
    }

    fn new(elements: Vec<Element>, center: C64, characters: Vec<Vec<C64>>) -> Self {
        let n = elements[0].image.len();
        let orbits = (0..n as u32).filter(|&j| elements.iter().all(|e| e.image[j as usize] >= j)).collect();
        Self { elements, center, characters, orbits }
    }

    /// Number of maps.
    pub(crate) fn order(&self) -> usize {
        self.elements.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::curve::{Curve, Resolution};
    use crate::{Body, Shape};

    fn nodes(shape: Shape) -> Vec<C64> {
        let body = Body { shape, center_um: [1.0, -2.0], rotation_rad: 0.7, eta: 1.5, kappa: 0.0, lumen: None };
        let curve = Curve::new(&body, &Resolution::for_tolerance(1e-6), 0.4, "fiber[0]").unwrap();
        curve.nodes.iter().map(|p| C64::new(p.at[0], p.at[1])).collect()
    }

    fn polygon(corners: usize, stretch: f64) -> Shape {
        let corner = |j: usize| {
            let a = TAU * j as f64 / corners as f64;
            [2.0 * stretch * a.cos(), 2.0 * a.sin()]
        };
        Shape::Polygon { points_um: (0..corners).map(corner).collect(), rounding_um: 0.3 }
    }

    #[test]
    fn orders_are_found() {
        let fourier = Shape::Fourier { coeffs: vec![(1, C64::new(2.0, 0.0)), (-2, C64::new(0.2, 0.0))] };
        let crooked =
            Shape::Fourier { coeffs: vec![(1, C64::new(2.0, 0.0)), (-2, C64::new(0.2, 0.1)), (2, C64::new(0.1, 0.0))] };
        let cases = [
            (Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, 4),
            (Shape::Circle { radius_um: 1.0 }, 48),
            (polygon(3, 1.0), 3),
            (polygon(3, 1.3), 2),
            (polygon(4, 1.0), 4),
            (polygon(6, 1.0), 6),
            (fourier, 3),
            (crooked, 1),
        ];
        for (shape, want) in cases {
            let points = nodes(shape.clone());
            let group = Group::detect(&points, &[points.len()]);
            if want == 48 {
                assert!(group.order() >= 12, "circle: {}", group.order());
            } else {
                assert_eq!(group.order(), want, "{shape:?}");
            }
            assert_eq!(group.orbits.len() * group.order(), points.len(), "{shape:?}: maps are free");
            // Characters: chi(a) chi(b) = chi(ab).
            for chi in &group.characters {
                for (a, ea) in group.elements.iter().enumerate() {
                    for (b, eb) in group.elements.iter().enumerate() {
                        let product = ea.image[eb.image[0] as usize];
                        let ab = group.elements.iter().position(|e| e.image[0] == product).unwrap();
                        assert!((chi[a] * chi[b] - chi[ab]).norm() < 1e-12);
                    }
                }
            }
        }
    }
}

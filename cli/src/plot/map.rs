//! Latitude-longitude maps of a density over the outgoing sphere, with the axes and widths of its lobes.

use super::axes::{self, LogScale, Ticks};
use super::color;
use super::figure::{Figure, INK, Panel, WHITE};
use plywave::ply::asg::Lobe;
use plywave_tables::table::OutgoingGrid;

/// Values over the bins of the outgoing sphere, `values[theta_o][phi_o]`, last fastest.
#[derive(Clone, Debug)]
pub struct Field {
    /// The bins.
    pub grid: OutgoingGrid,
    /// One value a bin [1/sr].
    pub values: Vec<f64>,
}

impl Field {
    /// A table's slice.
    pub fn from_slice(grid: OutgoingGrid, slice: &[f32]) -> Self {
        Field { grid, values: slice.iter().map(|&v| v as f64).collect() }
    }

    /// `f(theta_o, phi_o)` at the centers of the bins.
    pub fn from_fn(grid: OutgoingGrid, mut f: impl FnMut(f64, f64) -> f64) -> Self {
        let mut values = Vec::with_capacity(grid.len());
        for i in 0..grid.theta_o {
            for j in 0..grid.phi_o {
                values.push(f(grid.theta(i), grid.phi(j)));
            }
        }
        Field { grid, values }
    }

    /// `self - other`, bin by bin.
    pub fn minus(&self, other: &Field) -> Field {
        Field { grid: self.grid, values: self.values.iter().zip(&other.values).map(|(a, b)| a - b).collect() }
    }

    /// The value that all but a share of 5e-4 of the sphere stays below: the top of a scale that a noisy bin
    /// at a pole cannot set.
    pub fn top(&self) -> f64 {
        let mut bins: Vec<(f64, f64)> =
            (0..self.grid.len()).map(|b| (self.values[b], self.grid.solid_angle(b / self.grid.phi_o))).collect();
        bins.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut left = 5e-4 * 4.0 * std::f64::consts::PI;
        for &(value, solid_angle) in &bins {
            left -= solid_angle;
            if left < 0.0 {
                return value;
            }
        }
        0.0
    }

    fn at(&self, u: f64, v: f64) -> f64 {
        let i = ((v * self.grid.theta_o as f64) as usize).min(self.grid.theta_o - 1);
        let j = ((u * self.grid.phi_o as f64) as usize).min(self.grid.phi_o - 1);
        self.values[i * self.grid.phi_o + j]
    }
}

/// How a map's values become colors.
#[derive(Clone, Copy, Debug)]
pub enum Coloring {
    /// Densities, sequential.
    Density(LogScale),
    /// Signed differences, diverging, on the densities' scale.
    Residual(LogScale),
}

/// Place of a direction on a map.
fn point(at: Panel, theta: f64, phi: f64) -> [f64; 2] {
    [
        f64::from(at.x) + phi / std::f64::consts::TAU * f64::from(at.w),
        f64::from(at.y) + (0.5 - theta / std::f64::consts::PI) * f64::from(at.h),
    ]
}

/// Draws a map: theta_o upwards from -90 to 90 degrees, phi_o rightwards from 0 to 360.
pub fn draw(figure: &mut Figure, at: Panel, field: &Field, coloring: Coloring) {
    figure.pixels(at, |i, j| {
        let u = (f64::from(i) + 0.5) / f64::from(at.w);
        let value = field.at(u, 1.0 - (f64::from(j) + 0.5) / f64::from(at.h));
        match coloring {
            Coloring::Density(scale) => color::sequential(scale.position(value)),
            Coloring::Residual(scale) => color::diverging(scale.signed(value)),
        }
    });
    figure.frame(at, INK);
}

/// Degree ticks of phi_o; 360 has none, so that neighbouring panels' numbers keep apart.
fn phi_ticks() -> Ticks {
    [0, 90, 180, 270].into_iter().map(|d| (d as f64 / 360.0, format!("{d}°"))).collect()
}

/// Degree ticks of theta_o; none at the poles, for the same reason.
fn theta_ticks(h: i32) -> Ticks {
    let degrees: &[i32] = if h >= 200 { &[-60, -30, 0, 30, 60] } else { &[-60, 0, 60] };
    degrees.iter().map(|&d| ((d as f64 + 90.0) / 180.0, format!("{d}°"))).collect()
}

/// Axes of a map: numbers below and at the left, each with or without the axis' name.
pub fn label(figure: &mut Figure, at: Panel, below: Option<bool>, left: Option<bool>) {
    let name = |shown: bool, name: &'static str| if shown { name } else { "" };
    if let Some(shown) = below {
        axes::below(figure, at, &phi_ticks(), name(shown, "φ_o"));
    }
    if let Some(shown) = left {
        axes::left(figure, at, &theta_ticks(at.h), name(shown, "θ_o"));
    }
}

/// Marks the mirror direction of a smooth cylinder's cone and the exact forward direction: the cone theta_o =
/// -theta_i as ticks on both edges, forward as a small ring at phi_o = 270 degrees.
pub fn mark_forward(figure: &mut Figure, at: Panel, theta_i: f64) {
    let center = point(at, -theta_i, 1.5 * std::f64::consts::PI);
    figure.clipped(at, |figure| {
        figure.ring(center, 6.0, 3.5, [0, 0, 0]);
        figure.ring(center, 6.0, 1.5, WHITE);
    });
    let y = center[1].round() as i32 - 1;
    for x in [at.x - 6, at.x + at.w + 1] {
        figure.fill(Panel { x, y, w: 5, h: 3 }, INK);
    }
}

/// Draws each lobe's axis as a dot, as large as its energy, and its two principal directions as arcs half a
/// standard deviation long each way: whole ones hide the map. Lobes with less than 1 % of the energy are left
/// out.
pub fn draw_lobes(figure: &mut Figure, at: Panel, lobes: &[Lobe]) {
    let total: f64 = lobes.iter().map(|l| l.energy).sum();
    let shown = || lobes.iter().filter(|l| l.energy > 0.01 * total);
    figure.clipped(at, |figure| {
        // Dark casings first, so that no lobe's casing cuts another's line.
        for (widen, color) in [(2.4, [0, 0, 0]), (0.0, WHITE)] {
            for lobe in shown() {
                let [x, y, z] = lobe.frame();
                for (axis, ln_mu) in [(x, lobe.ln_mu1), (y, lobe.ln_mu2)] {
                    let sd = (0.5 * (-ln_mu).exp()).sqrt().min(1.0).asin();
                    for piece in arc(at, z, axis, 0.5 * sd) {
                        figure.curve(piece, 1.2 + widen, color);
                    }
                }
                let radius = 2.0 + 6.0 * (lobe.energy / total).sqrt();
                figure.dot(point(at, z[2].clamp(-1.0, 1.0).asin(), azimuth(z)), radius + 0.5 * widen, color);
            }
        }
    });
}

fn azimuth(v: [f64; 3]) -> f64 {
    v[1].atan2(v[0]).rem_euclid(std::f64::consts::TAU)
}

/// The great-circle arc from -reach to reach [rad] about `z` towards `axis`; one that wraps around the map
/// comes in pieces, which end and begin off its edges.
fn arc(at: Panel, z: [f64; 3], axis: [f64; 3], reach: f64) -> Vec<Vec<[f64; 2]>> {
    let w = f64::from(at.w);
    let mut pieces: Vec<Vec<[f64; 2]>> = vec![Vec::new()];
    for i in -16..=16 {
        let (s, c) = (reach * f64::from(i) / 16.0).sin_cos();
        let v: [f64; 3] = std::array::from_fn(|a| c * z[a] + s * axis[a]);
        let next = point(at, v[2].clamp(-1.0, 1.0).asin(), azimuth(v));
        let piece = pieces.last_mut().expect("there is one from the start");
        match piece.last().copied() {
            Some(last) if (next[0] - last[0]).abs() >= 0.5 * w => {
                let turn = w.copysign(last[0] - next[0]);
                piece.push([next[0] + turn, next[1]]);
                pieces.push(vec![[last[0] - turn, last[1]], next]);
            }
            _ => piece.push(next),
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn top_ignores_a_lone_bin_at_a_pole_and_keeps_a_broad_peak() {
        let grid = OutgoingGrid { theta_o: 90, phi_o: 180 };
        let mut field = Field::from_fn(grid, |theta, _| theta.cos());
        field.values[0] = 1e6;
        let top = field.top();
        assert!((0.99..=1.0).contains(&top), "{top}");
    }

    #[test]
    fn map_puts_forward_where_its_axes_say() {
        let grid = OutgoingGrid { theta_o: 36, phi_o: 72 };
        // A lobe at theta_o = -45, phi_o = 270 degrees: right half, lower half.
        let field = Field::from_fn(grid, |t, p| f64::from((t + 0.785).abs() < 0.1 && (p - 4.712).abs() < 0.1));
        let mut figure = Figure::new(144, 72);
        let at = Panel { x: 0, y: 0, w: 144, h: 72 };
        draw(&mut figure, at, &field, Coloring::Density(LogScale { top: 0.0, decades: 3.0 }));
        let image = figure.raster();
        let (bright, dark) = (color::sequential(1.0), color::sequential(0.0));
        assert_eq!(image.get_pixel(108, 54).0, bright);
        assert_eq!(image.get_pixel(108, 18).0, dark);
        assert_eq!(image.get_pixel(36, 54).0, dark);
    }

    /// An arc across the seam leaves the map at one edge and enters it at the other; another is in one piece.
    #[test]
    fn arcs_wrap_around() {
        let at = Panel { x: 0, y: 0, w: 200, h: 100 };
        let whole = arc(at, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], 0.4);
        assert_eq!((whole.len(), whole[0].len()), (1, 33));
        let wrapped = arc(at, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.4);
        assert_eq!(wrapped.len(), 2);
        let (leaves, enters) = (wrapped[0].last().unwrap()[0], wrapped[1][0][0]);
        assert!(leaves >= 200.0 && enters <= 0.0 || leaves <= 0.0 && enters >= 200.0, "{leaves} {enters}");
    }
}

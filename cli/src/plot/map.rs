//! Latitude-longitude maps of a density over the outgoing sphere, with the axes and widths of its lobes.

use super::axes::{self, LogScale, Ticks};
use super::canvas::{Align, CAP, Canvas, INK, LINE, WHITE};
use super::colormap::{self, Rgb};
use plywave::OutgoingGrid;
use plywave::asg::Lobe;

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

    /// The value that all but a share of 5e-4 of the sphere stays below: the top of a scale that a noisy bin at a pole cannot set.
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

/// How a map's values become colours.
#[derive(Clone, Copy, Debug)]
pub enum Coloring {
    /// Densities, sequential.
    Density(LogScale),
    /// Signed differences, diverging, on the densities' scale.
    Residual(LogScale),
}

/// A panel of `w` by `h` dots at `(x, y)`.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    /// Left edge.
    pub x: i32,
    /// Upper edge.
    pub y: i32,
    /// Width.
    pub w: i32,
    /// Height.
    pub h: i32,
}

impl Panel {
    /// What may be drawn on: `[x0, y0, x1, y1)`.
    pub fn clip(&self) -> [i32; 4] {
        [self.x, self.y, self.x + self.w, self.y + self.h]
    }

    fn point(&self, theta: f64, phi: f64) -> [f64; 2] {
        [
            self.x as f64 + phi / std::f64::consts::TAU * self.w as f64,
            self.y as f64 + (0.5 - theta / std::f64::consts::PI) * self.h as f64,
        ]
    }
}

/// Draws a map: theta_o upwards from -90 to 90 degrees, phi_o rightwards from 0 to 360.
pub fn draw(canvas: &mut Canvas, panel: Panel, field: &Field, coloring: Coloring) {
    for j in 0..panel.h {
        let v = 1.0 - (j as f64 + 0.5) / panel.h as f64;
        for i in 0..panel.w {
            let value = field.at((i as f64 + 0.5) / panel.w as f64, v);
            let color = match coloring {
                Coloring::Density(scale) => colormap::sequential(scale.position(value)),
                Coloring::Residual(scale) => colormap::diverging(scale.signed(value)),
            };
            canvas.set(panel.x + i, panel.y + j, color);
        }
    }
    canvas.frame(panel.x, panel.y, panel.w, panel.h, INK);
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
pub fn label(canvas: &mut Canvas, panel: Panel, below: Option<bool>, left: Option<bool>) {
    if let Some(name) = below {
        axes::ticks_below(canvas, panel.x, panel.y + panel.h, panel.w, &phi_ticks());
        if name {
            canvas.text(panel.x + panel.w / 2, panel.y + panel.h + 12 + LINE, "φ_o", Align::Center, INK);
        }
    }
    if let Some(name) = left {
        axes::ticks_left(canvas, panel.x, panel.y, panel.h, &theta_ticks(panel.h));
        if name {
            canvas.text_up(panel.x - 80, panel.y + panel.h / 2, "θ_o", Align::Center, INK);
        }
    }
}

/// Room [dots] that [`label`] takes at the left.
pub const LEFT: i32 = 88;
/// Room [dots] that [`label`] takes below.
pub const BELOW: i32 = 12 + LINE + CAP + 8;

/// Marks the mirror direction of a smooth cylinder's cone and the exact forward direction: the cone theta_o = -theta_i as ticks
/// on both edges, forward as a small ring at phi_o = 270 degrees.
pub fn mark_forward(canvas: &mut Canvas, panel: Panel, theta_i: f64) {
    let center = panel.point(-theta_i, 1.5 * std::f64::consts::PI);
    for (width, color) in [(3.5, [0, 0, 0]), (1.5, WHITE)] {
        ring(canvas, center, 6.0, width, color, panel.clip());
    }
    let y = center[1] as i32;
    for x in [panel.x - 6, panel.x + panel.w + 1] {
        canvas.fill(x, y - 1, 5, 3, INK);
    }
}

fn ring(canvas: &mut Canvas, center: [f64; 2], r: f64, width: f64, color: Rgb, clip: [i32; 4]) {
    let at = |i: usize| {
        let (s, c) = (i as f64 / 24.0 * std::f64::consts::TAU).sin_cos();
        [center[0] + r * c, center[1] + r * s]
    };
    for i in 0..24 {
        canvas.stroke(at(i), at(i + 1), width, color, clip);
    }
}

/// Draws each lobe's axis as a dot, as large as its energy, and its two principal directions as arcs half a standard
/// deviation long each way: whole ones hide the map. Lobes with less than 1 % of the energy are left out.
pub fn draw_lobes(canvas: &mut Canvas, panel: Panel, lobes: &[Lobe]) {
    let total: f64 = lobes.iter().map(|l| l.energy).sum();
    let shown = || lobes.iter().filter(|l| l.energy > 0.01 * total);
    // Dark casings first, so that no lobe's casing cuts another's line.
    for (widen, color) in [(2.4, [0, 0, 0]), (0.0, WHITE)] {
        for lobe in shown() {
            let [x, y, z] = lobe.frame();
            for (axis, ln_mu) in [(x, lobe.ln_mu1), (y, lobe.ln_mu2)] {
                let sd = (0.5 * (-ln_mu).exp()).sqrt().min(1.0).asin();
                arc(canvas, panel, z, axis, 0.5 * sd, 1.2 + widen, color);
            }
            let r = 2.0 + 6.0 * (lobe.energy / total).sqrt();
            canvas.dot(panel.point(z[2].clamp(-1.0, 1.0).asin(), azimuth(z)), r + 0.5 * widen, color, panel.clip());
        }
    }
}

fn azimuth(v: [f64; 3]) -> f64 {
    v[1].atan2(v[0]).rem_euclid(std::f64::consts::TAU)
}

/// The great-circle arc from -reach to reach [rad] about `z` towards `axis`, cut where it wraps around the map.
fn arc(canvas: &mut Canvas, panel: Panel, z: [f64; 3], axis: [f64; 3], reach: f64, width: f64, color: Rgb) {
    let at = |i: i32| {
        let (s, c) = (reach * i as f64 / 16.0).sin_cos();
        let v: [f64; 3] = std::array::from_fn(|a| c * z[a] + s * axis[a]);
        panel.point(v[2].clamp(-1.0, 1.0).asin(), azimuth(v))
    };
    for i in -16..16 {
        let (mut a, mut b) = (at(i), at(i + 1));
        let w = panel.w as f64;
        if (a[0] - b[0]).abs() < 0.5 * w {
            canvas.stroke(a, b, width, color, panel.clip());
        } else {
            // The piece that wraps is drawn twice, once off each edge.
            let by = w.copysign(a[0] - b[0]);
            b[0] += by;
            canvas.stroke(a, b, width, color, panel.clip());
            a[0] -= by;
            b[0] -= by;
            canvas.stroke(a, b, width, color, panel.clip());
        }
    }
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
        let mut canvas = Canvas::new(144, 72);
        draw(
            &mut canvas,
            Panel { x: 0, y: 0, w: 144, h: 72 },
            &field,
            Coloring::Density(LogScale { top: 0.0, decades: 3.0 }),
        );
        let image = canvas.into_image();
        let (bright, dark) = (colormap::sequential(1.0), colormap::sequential(0.0));
        assert_eq!(image.get_pixel(108, 54).0, bright);
        assert_eq!(image.get_pixel(108, 18).0, dark);
        assert_eq!(image.get_pixel(36, 54).0, dark);
    }
}

//! A sheet to look at a weave by: both sides close up and from afar, the draft, and the textures in false
//! colors.
//!
//! Light falls from the upper left on smooth, dull fibers: enough to tell one weave from another, and no
//! more. How fabrics scatter light is not shown here.

use super::axes;
use super::color::{self, Rgb};
use super::figure::{Figure, INK, LINE, Panel, WHITE};
use super::page::{Head, page};
use super::text::literal;
use plywave::color::{srgb_decode, srgb_encode};
use plywave::fabric::{Fabric, Hit, YarnColor, YarnSet};
use plywave::math::vec3::dot;

const SIDE: i32 = 400;
const GAP: i32 = 24;

/// Towards the light, unit, for a viewer above the page.
const LIGHT: [f64; 3] = [-0.38, 0.50, 0.778];

fn encoded(linear: f64) -> u8 {
    (255.0 * srgb_encode(linear.clamp(0.0, 1.0))).round() as u8
}

/// Color of a yarn, linear. An absorption is shown as the gray of light that crosses 30 um of it.
fn dye(color: YarnColor) -> [f64; 3] {
    match color {
        YarnColor::Undyed => [srgb_decode(0.88); 3],
        YarnColor::Srgb(srgb) => srgb.map(|c| srgb_decode(f64::from(c))),
        YarnColor::Sigma(sigma) => [0.75 * (-30.0 * f64::from(sigma)).exp(); 3],
    }
}

/// What the viewer sees at a point, linear; from behind the fabric is turned about y.
fn seen(fabric: &Fabric, x_um: f64, y_um: f64, from_back: bool) -> [f64; 3] {
    let side = if from_back { -1.0 } else { 1.0 };
    let Hit::Ply(hit) = fabric.at((side * x_um) as f32, y_um as f32, [0.0, 0.0, side as f32]) else {
        return [srgb_decode(0.97); 3];
    };
    let turned = |v: [f32; 3]| [side * f64::from(v[0]), f64::from(v[1]), side * f64::from(v[2])];
    let [x, y, z] = hit.frame.map(turned);
    let radius = fabric.shape(hit.family).ply_radius_um;
    let sin = (f64::from(hit.h_um) / radius).clamp(-1.0, 1.0);
    let cos = (1.0 - sin * sin).sqrt();
    let normal: [f64; 3] = std::array::from_fn(|k| sin * x[k] + cos * y[k]);
    // Yarns that pass below others lie in their shadow.
    let depth = 0.75 + 0.25 * side * f64::from(hit.height_um) / f64::from(fabric.half_thickness_um());
    let diffuse = (0.22 + 0.85 * dot(normal, LIGHT).max(0.0)) * depth;
    let half = [LIGHT[0], LIGHT[1], LIGHT[2] + 1.0];
    let along = dot(z, half) / dot(half, half).sqrt();
    let gloss = 0.12 * (1.0 - along * along).powi(30) * dot(normal, LIGHT).max(0.0);
    dye(fabric.color(hit.family, hit.yarn)).map(|c| c * diffuse + gloss)
}

/// A panel of the fabric from (x, y) = 0 on, `um` um to a side, with `fine` by `fine` points to a pixel.
fn shaded(figure: &mut Figure, at: Panel, fabric: &Fabric, um: f64, fine: i32, from_back: bool) {
    figure.pixels(at, |i, j| {
        let mut sum = [0.0; 3];
        for s in 0..fine * fine {
            let (a, b) = (
                f64::from(i) + (f64::from(s % fine) + 0.5) / f64::from(fine),
                f64::from(j) + (f64::from(s / fine) + 0.5) / f64::from(fine),
            );
            let light = seen(fabric, a / f64::from(at.w) * um, (1.0 - b / f64::from(at.h)) * um, from_back);
            (0..3).for_each(|k| sum[k] += light[k] / f64::from(fine * fine));
        }
        sum.map(encoded)
    });
}

/// A panel of `color(x, y)` [um], or white where that is `None`.
fn mapped(figure: &mut Figure, at: Panel, um: f64, color: impl Fn(f32, f32) -> Option<Rgb>) {
    figure.pixels(at, |i, j| {
        let x = (f64::from(i) + 0.5) / f64::from(at.w) * um;
        let y = (1.0 - (f64::from(j) + 0.5) / f64::from(at.h)) * um;
        color(x as f32, y as f32).unwrap_or(WHITE)
    });
}

/// The draft: a square a crossing, at most 32 to a side, dark where the warp is on top.
fn drafted(figure: &mut Figure, at: Panel, fabric: &Fabric) {
    let draft = fabric.draft();
    let n = draft.ends().max(draft.picks()).clamp(8, 32) as i32;
    figure.pixels(at, |i, j| {
        let (end, pick) = (i * n / at.w, (at.h - 1 - j) * n / at.h);
        let up = draft.up(pick as usize % draft.picks(), end as usize % draft.ends());
        if up { [60, 72, 110] } else { [236, 228, 210] }
    });
}

/// The sheet.
pub fn sheet(name: &str, particulars: &[String], fabric: &Fabric) -> Figure {
    let spacing = YarnSet::EACH.map(|f| fabric.shape(f).spacing_um);
    let [a, b] = fabric.repeat_um();
    // Close up: a repeat or two, between 6 and 12 yarns.
    let near = (2.0 * a.max(b)).clamp(6.0 * spacing[0].max(spacing[1]), 12.0 * spacing[0].max(spacing[1]));
    let far = 5.0 * near;
    let head = Head {
        title: literal(name, 80),
        particulars: particulars.iter().map(|row| literal(row, 300)).collect(),
        ..Head::default()
    };
    let mm = |um: f64| format!("{:.2} mm", um / 1000.0);
    let half = f64::from(fabric.half_thickness_um());
    let titles = [
        format!("face, {}", mm(near)),
        format!("back, {}", mm(near)),
        format!("face, {}", mm(far)),
        format!("back, {}", mm(far)),
        "draft: dark, warp on top".to_string(),
        format!("height: ±{half:.0} μm"),
        "across the yarn: edge to edge".to_string(),
        "direction: x, y, z as r, g, b".to_string(),
    ];
    let row = SIDE + 2 * LINE;
    page(&head, [4 * SIDE + 3 * GAP, 2 * row], |figure, x, y| {
        let panel = |k: i32| Panel { x: x + (k % 4) * (SIDE + GAP), y: y + LINE + (k / 4) * row, w: SIDE, h: SIDE };
        for (k, title) in (0..).zip(&titles) {
            axes::above(figure, panel(k), title);
            figure.frame(panel(k), INK);
        }
        for (k, from_back) in [false, true].into_iter().enumerate() {
            shaded(figure, panel(k as i32), fabric, near, 2, from_back);
            shaded(figure, panel(2 + k as i32), fabric, far, 4, from_back);
        }
        drafted(figure, panel(4), fabric);
        mapped(figure, panel(5), near, |x, y| {
            let place = fabric.yarn_at(x, y, false)?;
            Some(color::sequential(0.5 + 0.5 * f64::from(place.height_um) / half))
        });
        mapped(figure, panel(6), near, |x, y| {
            let place = fabric.yarn_at(x, y, false)?;
            Some(color::diverging(2.0 * f64::from(place.across_um) / fabric.shape(place.family).width_um()))
        });
        mapped(figure, panel(7), near, |x, y| {
            Some(fabric.yarn_at(x, y, false)?.tangent.map(|t| (127.5 + 127.5 * t).round() as u8))
        });
    })
}

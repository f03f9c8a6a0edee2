//! Sections through a cloth: cut across its two directions, and seen from the face.

use super::axes;
use super::color::Rgb;
use super::figure::{Figure, LINE, Panel, WHITE};
use super::page::{Head, page};
use plywave::cloth::{ClothCurves, Lattice};
use plywave::math::vec3::dot;
use plywave_sim::cloth::ClothSolid;

/// Width of a section [pixels].
const WIDE: i32 = 900;
/// Height of the view of the face [pixels].
const FACE: i32 = 600;
const GAP: i32 = 34;
/// Unit direction towards the light of that view.
const LIGHT: [f64; 3] = [-0.38, 0.50, 0.778];
/// Cuts in each direction.
const CUTS: usize = 3;
/// Colors of the kinds of yarn.
const COLORS: [Rgb; 2] = [[176, 58, 46], [36, 92, 156]];

/// Cuts through a cloth: planes across x, then across y, at even distances over the cell.
pub fn sections(name: &str, particulars: &str, cloth: &ClothCurves) -> plywave::Result<Figure> {
    let lattice = cloth.lattice("cloth")?;
    let solid = ClothSolid::new(cloth)?;
    let span_um = span_um(cloth, &lattice);
    let points = cloth.curves.iter().flat_map(|c| c.control_um.iter().map(move |p| p[2].abs() + c.radius_um));
    let half_um = 1.1 * points.fold(0.0, f64::max);
    let high = ((2.0 * half_um / span_um * f64::from(WIDE)).ceil() as i32).clamp(8, 2 * WIDE);
    let head = Head { title: name.into(), particulars: vec![particulars.into()], ..Head::default() };
    let rows = 2 * CUTS as i32;
    let size = [WIDE + 2 * GAP, FACE + LINE + GAP + rows * (high + LINE + GAP)];
    Ok(page(&head, size, |figure, x, mut y| {
        let panel = Panel { x: x + GAP / 2, y: y + LINE, w: WIDE, h: FACE };
        axes::above(figure, panel, &format!("the face, {span_um:.0} um wide"));
        let um = span_um / f64::from(WIDE);
        figure.pixels(panel, |i, j| {
            let top = solid.top_at([(f64::from(i) + 0.5) * um, (f64::from(FACE - j) - 0.5) * um]);
            top.map_or(WHITE, |(curve, height, normal)| {
                // The light comes from the upper left; deeper points are darker.
                let diffuse = dot(normal, LIGHT).max(0.0);
                let depth = 0.6 + 0.4 * (height / half_um).clamp(-1.0, 1.0);
                shade(cloth, curve, (0.15 + 0.85 * diffuse) * depth)
            })
        });
        y += FACE + LINE + GAP;
        for across in [0, 1] {
            for cut in 0..CUTS {
                let at_um = span_um * (cut as f64 + 0.5) / CUTS as f64;
                let panel = Panel { x: x + GAP / 2, y: y + LINE, w: WIDE, h: high };
                let axis = ["x", "y"][across];
                axes::above(figure, panel, &format!("cut at {axis} = {at_um:.0} um, {span_um:.0} um wide"));
                let place = |i: i32, j: i32| {
                    let along = (f64::from(i) + 0.5) / f64::from(WIDE) * span_um;
                    let z = half_um * (1.0 - 2.0 * (f64::from(j) + 0.5) / f64::from(high));
                    let mut p = [at_um, along, z];
                    if across == 1 {
                        p.swap(0, 1);
                    }
                    p
                };
                figure.pixels(panel, |i, j| solid.ply_at(place(i, j)).map_or(WHITE, |ply| color(cloth, ply)));
                y += high + LINE + GAP;
            }
        }
    }))
}

/// Color of a ply: that of its kind, darker at its surface.
fn color(cloth: &ClothCurves, (curve, off): (usize, f64)) -> Rgb {
    shade(cloth, curve, if off > 0.9 { 0.45 } else { 1.0 })
}

/// Color of a ply's kind, in this light.
fn shade(cloth: &ClothCurves, curve: usize, light: f64) -> Rgb {
    let kind = cloth.yarns[cloth.curves[curve].yarn as usize].kind as usize;
    COLORS[kind % COLORS.len()].map(|c| (f64::from(c) * light).clamp(0.0, 255.0) as u8)
}

/// Extent of the cloth that is shown: some yarns, or a small repeat twice.
fn span_um(cloth: &ClothCurves, lattice: &Lattice) -> f64 {
    let thickest = cloth.curves.iter().map(|c| c.radius_um).fold(0.0, f64::max);
    let per_yarn = (cloth.curves.len() as f64 / cloth.yarns.len() as f64).sqrt();
    let cell = lattice.area_um2().sqrt();
    (2.0 * cell).clamp(16.0 * thickest * per_yarn, 60.0 * thickest * per_yarn)
}

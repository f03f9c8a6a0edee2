//! ci: build only
//!
//! A figure of a family of plies: loops of one ply, from the hardest twist to the least, all from one file.
//!
//! ```text
//! cargo run --release -p plywave-render --example family_slider -- FAMILY.pwfam OUT.png
//! ```
//!
//! Twelve panels, left to right and top to bottom, the pitch from one end of the family to the other in equal
//! steps of the lean of its rim's fibers. Every panel is a ply bent to a circle, seen from above, under a
//! lamp from the left and a fainter one from the right; every pixel queries the family at its own incidence
//! (`PlyFamily::on`).

use plywave::ply::{FamilyParam, FamilyParams, PlyFamily};
use plywave::{Bsdf, PlyQuery};

/// Pixels of a panel, and panels along x and y.
const PANEL: u32 = 220;
const PANELS: [u32; 2] = [4, 3];
/// Radius of the circle and of the ply, in halves of a panel.
const RING: f32 = 0.68;
const PLY: f32 = 0.24;

fn unit(v: [f32; 3]) -> [f32; 3] {
    let n = dot(v, v).sqrt();
    v.map(|x| x / n)
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(path), Some(out)) = (args.next(), args.next()) else { return Err("give FAMILY.pwfam OUT.png".into()) };
    let family = PlyFamily::load(&path)?;
    let pitches = family.data().values(FamilyParam::FiberPitch).ok_or("the family has no twists")?;
    let spec = family.spec_at(&family.params());
    let radius = spec.ply_ring().radius_um;
    let param = FamilyParam::FiberPitch;
    let ends = [pitches[0], pitches[pitches.len() - 1]].map(|p| param.coordinate(p, radius));
    let panels = PANELS[0] * PANELS[1];
    let lamps = [([-0.75f32, 0.35, 0.6], 1.0f32), ([0.8, 0.1, 0.55], 0.35)].map(|(w, e)| (unit(w), e));
    // A blue dye, as absorptions at red, green and blue.
    let sigma = [0.012f32, 0.006, 0.0015];
    let begun = std::time::Instant::now();
    let mut asked = 0u64;
    let mut picture = image::RgbImage::new(PANEL * PANELS[0], PANEL * PANELS[1]);
    for panel in 0..panels {
        let x = ends[0] + (ends[1] - ends[0]) * f64::from(panel) / f64::from(panels - 1);
        let pitch = param.of_coordinate(x, radius).clamp(pitches[0], pitches[pitches.len() - 1]);
        let params = FamilyParams { fiber_pitch_um: pitch, ..family.params() };
        println!("panel {}: pitch {pitch:.0} um", panel + 1);
        for py in 0..PANEL {
            for px in 0..PANEL {
                let to = |p: u32| (p as f32 + 0.5) / PANEL as f32 * 2.0 - 1.0;
                let (x, y) = (to(px), -to(py));
                let from = (x * x + y * y).sqrt();
                let across = (from - RING) / PLY;
                let mut color = [0.03f32; 3];
                if across.abs() < 1.0 {
                    // The ply's frame: z along it, y towards the eye, x across, outwards.
                    let (z, up) = ([-y / from, x / from, 0.0], [0.0, 0.0, 1.0]);
                    let outwards = [x / from, y / from, 0.0];
                    // x = y cross z is -outwards for this z.
                    let right = outwards.map(|v| -v);
                    let query = PlyQuery::lobes(0.0, -across * radius as f32, sigma);
                    let ply = family.on(&params, &query);
                    asked += 1;
                    color = [0.0; 3];
                    for (lamp, power) in lamps {
                        let w = [dot(lamp, right), dot(lamp, up), dot(lamp, z)];
                        let f = ply.eval(w);
                        (0..3).for_each(|k| color[k] += 9.0 * power * f[k]);
                    }
                }
                let srgb = |v: f32| {
                    let v = v / (1.0 + 0.3 * v);
                    let s = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
                    (s.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
                };
                let at = [(panel % PANELS[0]) * PANEL + px, (panel / PANELS[0]) * PANEL + py];
                picture.put_pixel(at[0], at[1], image::Rgb(color.map(srgb)));
            }
        }
    }
    picture.save(&out)?;
    println!("{out}: {asked} incidences of {panels} yarns in {:.2} s", begun.elapsed().as_secs_f64());
    Ok(())
}

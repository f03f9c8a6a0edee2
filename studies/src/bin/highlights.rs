//! Highlights of a ply's fibers, of sections as simulation packs them: how many a viewer sees.
//!
//! `cargo run --release -p plywave-studies --bin highlights -- YARN.toml..`
//!
//! Fibers count as circles of their area. A highlight is where the normal halves the angle alpha between
//! viewer and light, in the plane of the section; it is seen where no other fiber lies before it on the way
//! to either. A row has alpha; the mean number of highlights and its standard deviation from view to view;
//! the root mean square of x over R where fibers with highlights have their middles; how far these lie from
//! the axis, over R; and the distance in x of two neighbors over that of evenly spread ones: mean and
//! standard deviation over the mean.

use plywave::ply::Relief;
use plywave::spec::YarnSpec;
use plywave_sim::PlySection;
use std::f64::consts::{PI, TAU};

const SECTIONS: u64 = 60;
const VIEWS: usize = 48;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for file in std::env::args().skip(1) {
        let spec = YarnSpec::parse(&std::fs::read_to_string(&file)?, &file)?;
        let r = (spec.fiber_area_um2() / PI).sqrt();
        let ply = spec.ply_radii_um()[0];
        let rule = Relief::of_spec(&spec).map_or(0.0, |relief| relief.highlights());
        println!("{}: {} fibers of {r:.2} um in {ply:.1} um; by relief's rules {rule:.1}", spec.name, spec.ply.fibers);
        let sections: Vec<PlySection> =
            (0..SECTIONS).filter_map(|seed| PlySection::generate(&spec, seed).ok()).collect();
        for alpha_deg in [0.0f64, 40.0, 80.0, 120.0, 160.0] {
            let (mut n, mut n2, mut x2, mut rho, mut views) = (0.0, 0.0, 0.0, 0.0, 0.0);
            let (mut gaps, mut gaps2, mut pairs) = (0.0, 0.0, 0.0);
            for section in &sections {
                let at: Vec<[f64; 2]> = section.fibers.iter().map(|f| [f.center_um.x, f.center_um.y]).collect();
                for view in 0..VIEWS {
                    let phi = TAU * view as f64 / VIEWS as f64;
                    let way = |phi: f64| [phi.cos(), phi.sin()];
                    let (to_view, normal) = (way(phi), way(phi + 0.5 * alpha_deg.to_radians()));
                    let to_light = way(phi + alpha_deg.to_radians());
                    let free = |i: usize, from: [f64; 2], to: [f64; 2]| {
                        at.iter().enumerate().all(|(j, other)| {
                            let off = [other[0] - from[0], other[1] - from[1]];
                            let along = off[0] * to[0] + off[1] * to[1];
                            j == i || along < 0.0 || (off[0] * to[1] - off[1] * to[0]).abs() > r
                        })
                    };
                    let mut xs = Vec::new();
                    for (i, c) in at.iter().enumerate() {
                        let spot = [c[0] + r * normal[0], c[1] + r * normal[1]];
                        if free(i, spot, to_view) && free(i, spot, to_light) {
                            xs.push(c[1] * to_view[0] - c[0] * to_view[1]);
                            rho += (c[0] * c[0] + c[1] * c[1]).sqrt() / ply;
                        }
                    }
                    xs.sort_by(f64::total_cmp);
                    n += xs.len() as f64;
                    n2 += (xs.len() * xs.len()) as f64;
                    x2 += xs.iter().map(|x| x * x).sum::<f64>();
                    for pair in xs.windows(2) {
                        gaps += pair[1] - pair[0];
                        gaps2 += (pair[1] - pair[0]).powi(2);
                        pairs += 1.0;
                    }
                    views += 1.0;
                }
            }
            let mean = n / views;
            let gap = gaps / pairs;
            println!(
                "  {alpha_deg:>3.0}: {mean:.2} +- {:.2}, x {:.3}, from the axis {:.3}, apart {:.3} um +- {:.2}",
                (n2 / views - mean * mean).max(0.0).sqrt(),
                (x2 / n).sqrt() / ply,
                rho / n,
                gap,
                (gaps2 / pairs - gap * gap).max(0.0).sqrt() / gap
            );
        }
    }
    Ok(())
}

//! Relaxation moves no strand through another one.

use super::super::layout::knitted;
use super::Random;
use crate::cloth::relax::{Elements, MAX_OVERLAP, Nodes, Rest, follow, touching};
use plywave_textile::{ClothSpec, ClothWeave};

type Vector = [f64; 3];

fn sub(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|k| a[k] - b[k])
}

/// Six times the volume between two segments.
fn volume([p, q, r, s]: [Vector; 4]) -> f64 {
    let (a, b, c) = (sub(q, p), sub(s, r), sub(r, p));
    a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// Distance of the segments of four points over the length of the first.
fn distance([p, q, r, s]: [Vector; 4]) -> f64 {
    let dot = |a: Vector, b: Vector| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let (u, v, w) = (sub(q, p), sub(s, r), sub(p, r));
    let (a, b, c, d, e) = (dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w));
    let mut best = f64::INFINITY;
    let inside = (a * c - b * b).max(1e-300);
    for s in [((b * e - c * d) / inside).clamp(0.0, 1.0), 0.0, 1.0] {
        let t = ((e + s * b) / c).clamp(0.0, 1.0);
        let s = ((t * b - d) / a).clamp(0.0, 1.0);
        let off: Vector = std::array::from_fn(|k| w[k] + s * u[k] - t * v[k]);
        best = best.min((dot(off, off) / a).sqrt());
    }
    best
}

/// Whether two segments that move straight from one place to another pass through each other on the way: at
/// a moment when their four points lie in a plane they cross.
fn passes(from: [Vector; 4], to: [Vector; 4]) -> bool {
    let at = |t: f64| -> [Vector; 4] {
        std::array::from_fn(|i| std::array::from_fn(|k| from[i][k] + t * (to[i][k] - from[i][k])))
    };
    // Steps are short, so the volume changes its sign once at most between these moments.
    const MOMENTS: usize = 4;
    (0..MOMENTS).any(|m| {
        let (mut low, mut high) = (m as f64 / MOMENTS as f64, (m + 1) as f64 / MOMENTS as f64);
        let first = volume(at(low));
        if first * volume(at(high)) > 0.0 {
            return false;
        }
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            *(if first * volume(at(middle)) > 0.0 { &mut low } else { &mut high }) = middle;
        }
        distance(at(low)) < 1e-6
    })
}

/// Elements that lie so near on their strand do not touch each other in a relaxation, and a kink may turn.
const NEIGHBORS: usize = 12;

/// Whether two elements, the second of them translated, are near on one strand.
fn is_neighbor(cloth: &Elements, nodes: &Nodes, [a, b]: [u32; 2], by: [f64; 2]) -> bool {
    let [c, d] = [a, b].map(|g| nodes.chain[g as usize] as usize);
    let (count, apart) = (cloth.chains[c].points_um.len(), a.abs_diff(b) as usize);
    let period = nodes.period[c];
    let is_next = (by[0].abs() - period[0].abs()).hypot(by[1].abs() - period[1].abs()) < 1e-6;
    c == d && (apart < NEIGHBORS && by == [0.0; 2] || count - apart < NEIGHBORS && is_next)
}

/// Relaxes a knit and counts strands that pass through others.
fn relaxed(text: &str) -> (usize, f64, f64, usize) {
    let spec = ClothSpec::parse(text, "s.toml").unwrap();
    let Some(ClothWeave::Knitted(knit, yarn)) = spec.made() else { panic!("knitted") };
    let mut cloth: Elements = knitted(knit, &knit.kind, yarn).unwrap_or_else(|e| panic!("{e:?}")).elements;
    let mut own = cloth.clone();
    // A step moves nodes by some 0.3 R at most, so elements that passed each other are as near as this.
    own.chains.iter_mut().for_each(|chain| chain.radius_um *= 0.3);
    let nodes = Nodes::new(&own);
    let mut last: Option<Vec<f64>> = None;
    let mut passed = 0;
    let relaxed = {
        let mut step = |_: f64, x: &[f64]| {
            if let Some(before) = last.as_mut() {
                let ends = |x: &[f64], g: u32, by: [f64; 2]| {
                    [Nodes::at(x, g as usize), nodes.end(x, g as usize)].map(|p| [p[0] + by[0], p[1] + by[1], p[2]])
                };
                for (a, b, by) in touching(&own, x) {
                    if is_neighbor(&own, &nodes, [a, b], by) {
                        continue;
                    }
                    let of = |x: &[f64]| -> [Vector; 4] {
                        let ([p, q], [r, s]) = (ends(x, a, [0.0; 2]), ends(x, b, by));
                        [p, q, r, s]
                    };
                    passed += usize::from(passes(of(before), of(x)));
                }
                before.copy_from_slice(x);
            } else {
                last = Some(x.to_vec());
            }
            true
        };
        follow(&mut cloth, Rest::Full, &mut step).unwrap()
    };
    (passed, relaxed.force, relaxed.overlap, relaxed.steps)
}

fn spec(chart: &str, sizes: &str) -> String {
    format!(
        "name = \"x\"\n[knit]\nkind = \"chart\"\nchart = {chart}\n{sizes}\n[yarn]\nfiber = \"cotton\"\ncount = \"Ne 30\"\n"
    )
}

const SIZES: &str = "wales_per_cm = 13\ncourses_per_cm = 18\nloop_mm = 2.7";

/// A strand that is pulled through another one is found.
#[test]
fn passing_strands_are_found() {
    let from = [[-1.0, 0.0, 1.0], [1.0, 0.1, 1.0], [0.0, -1.0, 0.0], [0.1, 1.0, 0.0]];
    let moved = |by: f64, x: f64| from.map(|p| if p[2] > 0.5 { [p[0] + x, p[1], p[2] - by] } else { p });
    assert!(passes(from, moved(2.0, 0.0)) && !passes(from, moved(0.5, 0.0)) && !passes(from, moved(2.0, 3.0)));
}

fn check(charts: &[String]) {
    for chart in charts {
        let (passed, force, overlap, steps) = relaxed(&spec(chart, SIZES));
        println!("{chart}: {steps} steps, force {force:.1e}, overlap {overlap:.4}, {passed} passed");
        assert!(passed == 0 && force < 1e-2 && overlap < MAX_OVERLAP, "{chart}: {passed} {force} {overlap}");
    }
}

/// Charts of each stitch come to rest with the crossings of their start.
#[test]
fn strands_do_not_pass_through_each_other() {
    let charts = [
        "[\"KKKK\", \"K>KK\", \"KKKK\", \"KK<K\"]",
        "[\"KKKKPP\", \"KKKKPP\", \"KKKKPP\", \"RRllPP\"]",
        "[\"KK\", \"KT\", \"KK\", \"TK\"]",
        "[\"KK\", \"KM\", \"KK\", \"MK\"]",
    ]
    .map(String::from);
    check(&charts);
}

/// So do random charts.
#[test]
#[ignore = "slow: 40 s: random charts keep their crossings"]
fn random_charts_keep_their_crossings() {
    let mut random = Random(5);
    let charts: Vec<String> = (0..20).map(|_| format!("{:?}", random.chart(4).0)).collect();
    check(&charts);
}

/// The charts of the knits that ship.
#[test]
#[ignore = "slow: 15 s: shipped charts keep their crossings"]
fn shipped_charts_keep_their_crossings() {
    for (name, text) in [
        ("cable", include_str!("../../../../../fabrics/cloths/cable.toml")),
        ("lace", include_str!("../../../../../fabrics/cloths/lace.toml")),
    ] {
        let (passed, force, overlap, steps) = relaxed(text);
        println!("{name}: {steps} steps, force {force:.1e}, overlap {overlap:.4}, {passed} passed");
        assert!(passed == 0 && force <= 1e-5 && overlap < MAX_OVERLAP, "{name}: {passed} {force} {overlap}");
    }
}

//! Rays and strands compared with a brute-force reference in 64 bits, without tree or closed form: the entry
//! into each of many balls along the curve, the best refined by golden section; splines by de Boor's scheme.
//! Splines are traced as straight pieces within 2 % of the radius, so their hits are bracketed by tubes of
//! 0.97 and 1.03 radii.

use glam::{DVec3, Vec3};
use plywave_render::{Basis, Skip, StrandHit, StrandShape, StrandTree, Strands};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// The curve of a segment at u: center and radius.
fn curve(basis: Basis, p: &[[f32; 4]], u: f64) -> (DVec3, f64) {
    let wide = |k: usize| (DVec3::new(p[k][0].into(), p[k][1].into(), p[k][2].into()), f64::from(p[k][3]));
    let mix = |a: (DVec3, f64), b: (DVec3, f64), t: f64| (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t);
    match basis {
        Basis::Linear => mix(wide(0), wide(1), u),
        Basis::BSpline => {
            // De Boor on uniform knots -2 .. 3.
            let one: Vec<_> = (0..3).map(|i| mix(wide(i), wide(i + 1), (u + 2.0 - i as f64) / 3.0)).collect();
            let two: Vec<_> = (0..2).map(|i| mix(one[i], one[i + 1], (u + 1.0 - i as f64) / 2.0)).collect();
            mix(two[0], two[1], u)
        }
    }
}

/// Distance at which a ray enters the ball at u, of radii scaled by `scale`.
fn entry(basis: Basis, p: &[[f32; 4]], u: f64, o: DVec3, w: DVec3, scale: f64) -> f64 {
    let (c, r) = curve(basis, p, u);
    let along = (c - o).dot(w);
    let off = (c - o - w * along).length_squared();
    let room = r * r * scale * scale - off;
    if room >= 0.0 { along - room.sqrt() } else { f64::INFINITY }
}

/// First entry of a ray into all strands.
fn reference(strands: &Strands, o: DVec3, w: DVec3, scale: f64, samples: usize) -> f64 {
    let order = strands.basis().order();
    let mut best = f64::INFINITY;
    for points in strands.curves() {
        for p in points.windows(order) {
            // Search order: least `off - r`, then the entry.
            let gap = |u: f64| {
                let (c, r) = curve(strands.basis(), p, u);
                (c - o - w * (c - o).dot(w)).length() - r * scale
            };
            let f = |u: f64| entry(strands.basis(), p, u, o, w, scale);
            let step = 1.0 / samples as f64;
            let golden = |g: &dyn Fn(f64) -> f64, at: f64| {
                let (mut a, mut b) = ((at - step).max(0.0), (at + step).min(1.0));
                for _ in 0..80 {
                    let (x, y) = (b - 0.618_033_988_75 * (b - a), a + 0.618_033_988_75 * (b - a));
                    // If no ball is hit, towards the smaller gap.
                    let (fx, fy) = (g(x), g(y));
                    let left = if fx == fy { gap(x) < gap(y) } else { fx < fy };
                    if left { b = y } else { a = x }
                }
                0.5 * (a + b)
            };
            // Every local minimum of the gap: samples may miss a thin strand, these do not.
            for k in 0..=samples {
                let u = k as f64 * step;
                let (here, before, after) = (gap(u), gap((u - step).max(0.0)), gap((u + step).min(1.0)));
                let seen = f(u);
                best = best.min(seen);
                if here <= before && here <= after
                    || seen < f64::INFINITY && seen <= f((u - step).max(0.0)) && seen <= f((u + step).min(1.0))
                {
                    best = best.min(f(golden(&gap, u))).min(f(golden(&f, u)));
                }
            }
        }
    }
    best
}

fn tree(basis: Basis, curves: &[Vec<[f32; 4]>], shape: StrandShape) -> StrandTree {
    let mut strands = Strands::new(basis);
    for (k, points) in curves.iter().enumerate() {
        strands.push(points, "test", &format!("strand {k}")).unwrap();
    }
    StrandTree::new(strands, shape)
}

fn meet(tree: &StrandTree, o: DVec3, w: DVec3) -> Option<StrandHit> {
    tree.first(o, w, 0.0, f64::INFINITY, &[])
}

fn unit(rng: &mut Pcg64Mcg) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (s, c) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * c, r * s, z)
}

/// A ray that starts `distance` away, outside, and passes within about two radii of some point of the
/// strands.
fn aimed(strands: &Strands, distance: f64, rng: &mut Pcg64Mcg) -> (DVec3, DVec3) {
    let order = strands.basis().order();
    let segments: Vec<&[[f32; 4]]> = strands.curves().flat_map(|c| c.windows(order)).collect();
    let p = segments[rng.random_range(0..segments.len())];
    let (c, r) = curve(strands.basis(), p, rng.random());
    let target = c + unit(rng) * (2.0 * r * rng.random::<f64>());
    let w = unit(rng);
    (target - w * distance, w)
}

/// Compares the hits with the reference; returns the number of rays that hit.
fn held_to_reference(tree: &StrandTree, distance: f64, rays: usize, rng: &mut Pcg64Mcg) -> usize {
    let basis = tree.strands().basis();
    let (thin, thick, slack) = match basis {
        Basis::Linear => (1.0 - 1e-6, 1.0 + 1e-6, 1e-9),
        Basis::BSpline => (0.97, 1.03, 1e-9),
    };
    let mut hits = 0;
    for _ in 0..rays {
        let (o, w) = aimed(tree.strands(), distance, rng);
        let (first, last) = (reference(tree.strands(), o, w, thick, 60), reference(tree.strands(), o, w, thin, 60));
        match meet(tree, o, w) {
            Some(hit) => {
                hits += 1;
                let slack = slack * distance;
                assert!(hit.t >= first - slack && hit.t <= last + slack, "{} in {first} to {last}: {hit:?}", hit.t);
                let segment = &tree.strands().points()[hit.first_point as usize..][..basis.order()];
                let (center, radius) = curve(basis, segment, hit.u);
                assert!((hit.center - center).length() < 1e-9 * (1.0 + center.length()), "{hit:?} {center}");
                assert!((hit.radius_mm - radius).abs() < 1e-9 * radius, "{hit:?} {radius}");
                let off = (hit.position - hit.center).length() / radius;
                assert!((off - 1.0).abs() < 0.04, "{off} radii from the center: {hit:?}");
                assert!(hit.h_rel.abs() <= 1.0 && (hit.tangent.length() - 1.0).abs() < 1e-9);
            }
            None => assert!(last == f64::INFINITY, "missed at {last}: {o} {w}"),
        }
    }
    hits
}

/// Strands that turn sharply, taper, and overlap.
fn random_curves(rng: &mut Pcg64Mcg, basis: Basis, size: f32, radius: f32) -> Vec<Vec<[f32; 4]>> {
    (0..4)
        .map(|_| {
            let count = basis.order() + rng.random_range(0..6usize);
            (0..count)
                .map(|_| {
                    let [x, y, z, r]: [f32; 4] = rng.random();
                    [size * x, size * y, size * z, radius * (0.3 + r)]
                })
                .collect()
        })
        .collect()
}

#[test]
#[ignore = "slow: 5 s: tubes are the reference"]
fn tubes_are_the_reference() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for basis in [Basis::Linear, Basis::BSpline] {
        // Thick and thin, from near and from a meter away; the last is 1 um.
        for (size, radius, distance) in
            [(1.0, 0.2, 10.0), (10.0, 0.05, 30.0), (10.0, 0.05, 1000.0), (5.0, 0.001, 1000.0)]
        {
            let mut hits = 0;
            for _ in 0..6 {
                let tree = tree(basis, &random_curves(&mut rng, basis, size, radius), StrandShape::Tube);
                hits += held_to_reference(&tree, distance, 60, &mut rng);
            }
            assert!(hits > 100, "{basis:?} {size} {radius}: {hits} hits");
        }
    }
}

#[test]
fn far_from_the_origin_a_strand_is_what_its_numbers_say() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for basis in [Basis::Linear, Basis::BSpline] {
        let mut curves = random_curves(&mut rng, basis, 10.0, 0.01);
        curves.iter_mut().flatten().for_each(|p| (0..3).for_each(|k| p[k] += [20_000.0, -30_000.0, 8000.0][k]));
        let tree = tree(basis, &curves, StrandShape::Tube);
        assert!(held_to_reference(&tree, 500.0, 150, &mut rng) > 50);
    }
}

/// A ray to a point inside the tube always hits the tube first: no gaps at turns, between segments, or
/// between a spline's straight pieces.
#[test]
fn no_ray_gets_through() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let turn = |k: usize| if k.is_multiple_of(2) { 0.0 } else { 1.0 };
    let zigzag: Vec<[f32; 4]> = (0..30).map(|k| [0.02 * k as f32, turn(k), 0.3 * turn(k / 2), 0.004]).collect();
    for basis in [Basis::Linear, Basis::BSpline] {
        let tree = tree(basis, std::slice::from_ref(&zigzag), StrandShape::Tube);
        let order = basis.order();
        for n in 0..200_000u32 {
            let at = rng.random_range(0..zigzag.len() - order + 1);
            // Every second time exactly at a joint.
            let u = if n.is_multiple_of(2) { 0.0 } else { rng.random::<f64>() };
            let (c, r) = curve(basis, &zigzag[at..at + order], u);
            let w = unit(&mut rng);
            // Within the tube, a spline's pieces being 2 % off.
            let target = c + unit(&mut rng) * (0.97 * r * rng.random::<f64>());
            let distance = 40.0;
            let hit = meet(&tree, target - w * distance, w);
            assert!(hit.is_some_and(|hit| hit.t <= distance), "{basis:?} {at} {u}: {hit:?}");
        }
    }
}

/// The closed form of a cylinder: entry, offset with its sign, azimuth; Zinke's `xi = phi + asin h`.
#[test]
fn a_straight_strand_is_a_cylinder() {
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    for basis in [Basis::Linear, Basis::BSpline] {
        for shape in [StrandShape::Tube, StrandShape::Band] {
            let radius = 0.001f32;
            let points: Vec<[f32; 4]> = (0..5).map(|k| [0.0, 0.0, 50.0 * k as f32 - 100.0, radius]).collect();
            let tree = tree(basis, &[points], shape);
            let r = f64::from(radius);
            for _ in 0..5000 {
                let (phi, theta): (f64, f64) =
                    (std::f64::consts::TAU * rng.random::<f64>(), 2.4 * rng.random::<f64>() - 1.2);
                let wo = DVec3::new(theta.cos() * phi.cos(), theta.cos() * phi.sin(), theta.sin());
                let h = 2.4 * rng.random::<f64>() - 1.2;
                let middle = DVec3::new(-phi.sin(), phi.cos(), 0.0) * (h * r) + DVec3::Z * (10.0 * rng.random::<f64>());
                let hit = meet(&tree, middle + wo * 1000.0, -wo);
                if h.abs() > 1.0 + 1e-6 {
                    assert!(hit.is_none());
                } else if h.abs() < 1.0 - 1e-6 {
                    let hit = hit.unwrap_or_else(|| panic!("missed at h {h}"));
                    // Points of a spline are rounded to 32 bits nowhere; rays come from a meter.
                    assert!((hit.h_rel - h).abs() < 1e-6, "h {} for {h}", hit.h_rel);
                    let depth = if shape == StrandShape::Tube { (1.0 - h * h).sqrt() * r / theta.cos() } else { 0.0 };
                    assert!((hit.t - (1000.0 - depth)).abs() < 1e-8, "{} {}", hit.t, 1000.0 - depth);
                    let frame = hit.frame(Vec3::X);
                    let got = hit.phi(&frame, -wo);
                    assert!((got - phi).sin().abs() < 1e-7 && (got - phi).cos() > 0.0, "{got} {phi}");
                    if shape == StrandShape::Tube {
                        let xi =
                            (hit.position - hit.center).dot(frame[1]).atan2((hit.position - hit.center).dot(frame[0]));
                        assert!((xi - phi - h.asin()).sin().abs() < 1e-5, "xi {xi}, phi {phi}, h {h}");
                    }
                    // Straight lines leave the cylinder without another hit.
                    let w = unit(&mut rng);
                    let Skip { until, .. } = hit.leave(w);
                    let end = hit.position + w * until;
                    let off = (end - hit.center - hit.tangent * hit.tangent.dot(end - hit.center)).length();
                    assert!(off > r || until >= 1000.0 * r, "{off} {r}");
                    assert!(tree.first(hit.position, w, 0.0, f64::INFINITY, &[hit.leave(w)]).is_none());
                }
            }
        }
    }
}

/// Rays along the strand itself hit only its ends.
#[test]
fn ends_are_met_along_the_axis() {
    for basis in [Basis::Linear, Basis::BSpline] {
        let points: Vec<[f32; 4]> = (0..6).map(|k| [0.0, 0.0, k as f32, 0.1]).collect();
        let end = if basis == Basis::Linear { 5.0 } else { 4.0 };
        let tree = tree(basis, &[points], StrandShape::Tube);
        for x in [0.0, 0.03, 0.099] {
            let hit = meet(&tree, DVec3::new(x, 0.0, 1000.0), DVec3::NEG_Z).expect("the end is met");
            let ball = f64::from(0.1f32);
            let want = 1000.0 - end - (ball * ball - x * x).sqrt();
            assert!((hit.t - want).abs() < 1e-6, "{x}: {} {want}", hit.t);
        }
        assert!(meet(&tree, DVec3::new(0.101, 0.0, 1000.0), DVec3::NEG_Z).is_none());
    }
}

/// The hits do not depend on the form of the tree.
#[test]
fn trees_of_two_forms_answer_the_same() {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    for shape in [StrandShape::Tube, StrandShape::Band] {
        for basis in [Basis::Linear, Basis::BSpline] {
            let curves: Vec<_> = (0..40).flat_map(|_| random_curves(&mut rng, basis, 3.0, 0.03)).collect();
            let one = tree(basis, &curves, shape);
            let two = StrandTree::by_medians(one.strands().clone(), shape);
            let mut hits = 0;
            for _ in 0..20_000 {
                let (o, w) = aimed(one.strands(), 5.0, &mut rng);
                let (a, b) = (meet(&one, o, w), meet(&two, o, w));
                hits += usize::from(a.is_some());
                assert_eq!(a.map(|h| (h.t, h.first_point)), b.map(|h| (h.t, h.first_point)));
            }
            assert!(hits > 10_000, "{hits}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn random_strands(seed in any::<u64>(), spline in any::<bool>(), size in -1.0f32..2.0, thin in -3.2f32..-0.5, far in 0.0f64..3.0) {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let basis = if spline { Basis::BSpline } else { Basis::Linear };
        let size = 10f32.powf(size);
        let tree = tree(basis, &random_curves(&mut rng, basis, size, size * 10f32.powf(thin)), StrandShape::Tube);
        held_to_reference(&tree, 3.0 * f64::from(size) + 10f64.powf(far), 10, &mut rng);
    }
}

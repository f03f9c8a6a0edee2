//! Tests of hairs on a plain weave: number, lengths, directions and curvature against the distributions of
//! the spec, and distances from plies against a brute-force reference.

use super::*;
use plywave::spec::POLYESTER;

const RADIUS_UM: f64 = 50.0;
const HAIRS: Hairs = Hairs { per_mm: 5.0, length_mm: 0.4, curl_mm: 0.5, rise: 0.4, loops: 0.0 };

/// A plain weave of single plies.
fn plain() -> ClothCurves {
    let cell_um = [[600.0, 0.0], [0.0, 500.0]];
    let lattice = Lattice::new(cell_um).unwrap();
    let mut cloth = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
    for kind in 0..2usize {
        let (own, other) = (cell_um[1 - kind][1 - kind], cell_um[kind][kind]);
        let shift = if kind == 0 { [0, 1] } else { [1, 0] };
        for number in 0..2 {
            cloth.yarns.push(ClothYarn { kind: kind as u32, number, step: [0; 2], period: shift });
            let points: Vec<V3> = (0..32)
                .map(|i| {
                    let t = f64::from(i) / 32.0;
                    let mut p = [0.0; 3];
                    p[1 - kind] = t * own;
                    p[kind] = (0.25 + 0.5 * f64::from(number)) * other;
                    let up = if (number == 0) == (kind == 0) { 1.0 } else { -1.0 };
                    p[2] = up * 52.0 * (TAU * (t - 0.25)).cos();
                    p
                })
                .collect();
            let yarn = cloth.yarns.len() as u32 - 1;
            cloth.curves.push(PlyCurve::through(yarn, RADIUS_UM, shift, &points, &lattice));
        }
    }
    cloth.check("plain").unwrap();
    cloth
}

fn kind(hairs: Hairs) -> HairKind {
    HairKind::new(hairs, &YarnSpec::parse(POLYESTER, "polyester.toml").unwrap())
}

/// All hairs of a square of cells, with their yarns and cells.
fn grown(roots: &HairRoots<'_>, cells: i32) -> Vec<(usize, [i32; 2], Hair)> {
    let all = (0..4).flat_map(|yarn| (0..cells).flat_map(move |i| (0..cells).map(move |j| (yarn, [i, j]))));
    all.flat_map(|(yarn, cell)| roots.grow(yarn, cell, 1).into_iter().map(move |hair| (yarn, cell, hair))).collect()
}

/// Distance of a point from the axis of a curve in any cell near it, by brute force.
fn distance(cloth: &ClothCurves, curve: usize, p: V3) -> f64 {
    let lattice = cloth.lattice("plain").unwrap();
    let mut min = f64::MAX;
    for i in 0..800 {
        let q = cloth.curves[curve].at(&lattice, f64::from(i) / 25.0).point_um;
        let f = lattice.fractions(p[0] - q[0], p[1] - q[1]).map(|f| f.round() as i32);
        let v = lattice.vector(f);
        min = min.min(length([p[0] - q[0] - v[0], p[1] - q[1] - v[1], p[2] - q[2]]));
    }
    min
}

/// The number per millimeter, the lengths and the sides are those of the spec; roots lie on the plies.
#[test]
fn hairs_are_as_many_and_as_long_as_the_spec_says() {
    let cloth = plain();
    let roots = HairRoots::new(&cloth, vec![Some(kind(HAIRS)), Some(kind(HAIRS))]).unwrap();
    let cells = 30;
    let hairs = grown(&roots, cells);
    let lattice = cloth.lattice("plain").unwrap();
    let yarn_mm: f64 =
        1e-3 * f64::from(cells * cells) * cloth.curves.iter().map(|c| c.length_um(&lattice)).sum::<f64>();
    let (n, want) = (hairs.len() as f64, HAIRS.per_mm * yarn_mm);
    println!("{n} hairs on {yarn_mm:.1} mm of yarn, wanted {want:.1}");
    assert!((n - want).abs() < 5.0 * want.sqrt(), "{n} {want}");
    let mean_count = roots.mean_count(f64::from(cells * cells) * lattice.area_um2());
    assert!((mean_count - want).abs() < 1e-9 * want, "{mean_count} {want}");
    // Lengths are exponential: a share of exp(-x / mean) is longer than x, apart from the cut at 8 means.
    let uncut: Vec<f64> = hairs.iter().filter(|(.., h)| !h.is_cut).map(|(.., h)| h.length_um()).collect();
    let cut = 1.0 - uncut.len() as f64 / n;
    println!("cut {cut:.5}, mean {:.1} um", uncut.iter().sum::<f64>() / uncut.len() as f64);
    assert!(cut < 0.002, "{cut}");
    for x in [0.1, 0.4, 0.8, 1.2, 2.0] {
        let (got, want) = (uncut.iter().filter(|l| **l > 1e3 * x).count() as f64 / n, (-x / HAIRS.length_mm).exp());
        let se = (want * (1.0 - want) / n).sqrt();
        println!("longer than {x} mm: {got:.4}, exponential {want:.4}");
        assert!((got - want).abs() < 5.0 * se + 2e-3, "{x}: {got} {want}");
    }
    let (mut up, mut off) = (0.0, 0.0f64);
    for (.., hair) in &hairs {
        off = off.max((distance(&cloth, hair.curve as usize, hair.points_um[0]) - RADIUS_UM).abs());
        up += f64::from(u8::from(hair.points_um[hair.points_um.len() - 1][2] > 0.0)) / n;
    }
    println!("tips above {up:.4}, roots off their plies {off:.4} um");
    assert!((up - 0.5).abs() < 5.0 * 0.5 / n.sqrt(), "{up}");
    assert!(off < 0.1, "{off}");
}

/// No hair runs through a ply.
#[test]
fn hairs_stay_outside_of_plies() {
    let cloth = plain();
    let mixed = Hairs { loops: 0.3, length_mm: 1.0, ..HAIRS };
    let roots = HairRoots::new(&cloth, vec![Some(kind(mixed)), None]).unwrap();
    let hairs = grown(&roots, 6);
    let loops = hairs.iter().filter(|(.., h)| h.is_loop).count() as f64 / hairs.len() as f64;
    println!("{} hairs, {loops:.3} of them loops", hairs.len());
    assert!((loops - 0.3).abs() < 5.0 * (0.21 / hairs.len() as f64).sqrt(), "{loops}");
    let mut min = f64::MAX;
    for (yarn, _, hair) in &hairs {
        assert!(*yarn < 2, "a yarn without hairs has some");
        let ends = if hair.is_loop { hair.points_um.len() - 1 } else { hair.points_um.len() };
        for p in &hair.points_um[1..ends] {
            min = (0..4).map(|curve| distance(&cloth, curve, *p) - RADIUS_UM).fold(min, f64::min);
        }
        if hair.is_loop {
            let last = hair.points_um[hair.points_um.len() - 1];
            assert!((distance(&cloth, hair.curve as usize, last) - RADIUS_UM).abs() < 0.1);
        }
    }
    println!("nearest to a ply's surface: {min:.2} um");
    assert!(min > -0.1, "{min}");
}

/// The direction at the root and the curvature of unobstructed hairs are those of the spec.
#[test]
fn hairs_bend_and_rise_as_the_spec_says() {
    let mut cloth = plain();
    // One straight ply.
    cloth.yarns.truncate(1);
    let lattice = cloth.lattice("plain").unwrap();
    let points: Vec<V3> = (0..8).map(|i| [150.0, 62.5 * f64::from(i), 0.0]).collect();
    cloth.curves = vec![PlyCurve::through(0, RADIUS_UM, [0, 1], &points, &lattice)];
    let stiff = Hairs { length_mm: 0.5, curl_mm: 2.0, ..HAIRS };
    let roots = HairRoots::new(&cloth, vec![Some(kind(stiff))]).unwrap();
    let hairs: Vec<Hair> = (0..2000).flat_map(|i| roots.grow(0, [0, i], 3)).collect();
    // Flat hairs are pushed off the ply by their radius, which affects short ones most.
    const MIN_SINE: f64 = 0.3;
    let (mut rise, mut bend, mut n, mut all) = (0.0, 0.0, 0.0, 0.0);
    for hair in hairs.iter().filter(|hair| hair.length_um() > 300.0) {
        let [a, b, c] = [0, 1, 2].map(|i| hair.points_um[i]);
        let (d, e) = (unit(sub(b, a)), unit(sub(c, b)));
        let sine = dot(d, unit([a[0] - 150.0, 0.0, a[2]]));
        all += 1.0;
        if sine > MIN_SINE {
            rise += sine;
            bend += (length(cross(d, e)) / length(sub(b, a))).powi(2);
            n += 1.0;
        }
    }
    let (share, rise, bend) = (n / all, rise / n, (n / bend).sqrt());
    println!("{n} hairs, {share:.4} of all: mean sine {rise:.4}, radius of bends {bend:.1} um");
    // P(sine < s) = s^a.
    let a = stiff.rise / (1.0 - stiff.rise);
    let want_share = 1.0 - MIN_SINE.powf(a);
    let want = a / (a + 1.0) * (1.0 - MIN_SINE.powf(a + 1.0)) / want_share;
    assert!((share - want_share).abs() < 5.0 * 0.5 / f64::sqrt(all), "{share} {want_share}");
    assert!((rise - want).abs() < 5.0 * 0.2 / f64::sqrt(n) + 0.005, "{rise} {want}");
    assert!((bend / (1e3 * stiff.curl_mm) - 1.0).abs() < 0.05, "{bend}");
}

/// The same seed gives the same hairs and another seed others. The pieces of a rectangle contain each of its
/// hairs once.
#[test]
fn pieces_cover_a_rectangle_once() {
    let cloth = plain();
    let roots = HairRoots::new(&cloth, vec![Some(kind(HAIRS)), Some(kind(HAIRS))]).unwrap();
    assert_eq!(roots.grow(1, [3, -4], 7), roots.grow(1, [3, -4], 7));
    assert_ne!(roots.grow(1, [3, -4], 7), roots.grow(1, [3, -4], 8));
    let area = [[-700.0, 250.0], [3300.0, 2950.0]];
    let pieces = roots.pieces(area);
    let mut once = pieces.clone();
    once.sort_unstable();
    once.dedup();
    assert_eq!(once.len(), pieces.len());
    let inside = |p: &V3| (0..2).all(|k| (area[0][k]..area[1][k]).contains(&p[k]));
    let count = |pieces: &[(usize, [i32; 2])]| {
        let all = pieces.iter().flat_map(|(yarn, cell)| roots.grow(*yarn, *cell, 1));
        all.filter(|hair| inside(&hair.points_um[0])).count()
    };
    let wide = roots.pieces([[-3000.0, -2000.0], [6000.0, 6000.0]]);
    assert!(wide.len() > 2 * pieces.len());
    assert_eq!(count(&pieces), count(&wide));
}

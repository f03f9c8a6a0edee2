//! Charts of plain stitches have the curves of the closed form.

use super::super::curves::{POINTS, StartCurve};
use super::super::kinds::Knit;
use super::Random;
use plywave_textile::{Chart, KnitKind};
use std::f64::consts::{PI, TAU};

const SIZE: [f64; 3] = [714.0, 500.0, 85.0];

fn smooth(x: f64) -> f64 {
    let t = (0.5 * (x + 1.0)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A course of knit (true) and purl stitches after Peirce (1947), `next` being those of the next course.
fn peirce(own: &[bool], next: &[bool], at: f64, lift: f64, [wale, course, radius]: [f64; 3]) -> Vec<[f64; 3]> {
    let sign = |is_knit: bool| if is_knit { 1.0 } else { -1.0 };
    let count = own.len();
    let mut points = Vec::new();
    for w in 0..count {
        let [before, here, after] = [w + count - 1, w, w + 1].map(|i| sign(own[i % count]));
        let above = sign(next[w]);
        for i in 0..POINTS {
            let t = TAU * (i as f64 + 0.5) / POINTS as f64;
            let up = smooth((t - 0.5 * PI) * 4.0 / PI) * (1.0 - smooth((t - 1.5 * PI) * 4.0 / PI));
            let mut side = here + up * (above - here);
            side += (before - here) * (1.0 - smooth(t * 12.0 / PI));
            side += (after - here) * smooth((t - TAU) * 12.0 / PI);
            points.push([
                wale * (w as f64 + t / TAU) + 0.2 * wale * (2.0 * t).sin(),
                course * (at + 0.5) - 0.95 * course * t.cos(),
                side * (lift - 1.2 * radius * (2.0 * t).cos()),
            ]);
        }
    }
    points
}

fn check(curves: &[StartCurve], rows: &[Vec<bool>], lift: f64, name: &str) {
    assert_eq!(curves.len(), rows.len(), "{name}");
    for (c, curve) in curves.iter().enumerate() {
        let want = peirce(&rows[c], &rows[(c + 1) % rows.len()], c as f64, lift, SIZE);
        assert_eq!(curve.points_um, want, "{name}, course {c}");
        assert_eq!((curve.loops, curve.shift, &curve.yarn), (rows[c].len() as f64, [1, 0], &None), "{name}");
    }
}

#[test]
fn plain_charts_have_the_curves_of_the_closed_form() {
    let mut random = Random(1);
    for _ in 0..200 {
        let (wales, courses) = (1 + random.below(6), 1 + random.below(6));
        let rows: Vec<Vec<bool>> = (0..courses).map(|_| (0..wales).map(|_| random.below(2) == 0).collect()).collect();
        // The last row is the first course.
        let text: Vec<String> =
            rows.iter().rev().map(|row| row.iter().map(|knit| if *knit { 'K' } else { 'P' }).collect()).collect();
        let knit = Knit::new(&KnitKind::Chart(Chart::from_rows(&text).unwrap())).unwrap();
        let [wale, course, radius] = SIZE;
        check(&knit.curves(wale, course, radius), &rows, 0.0, &text.join(" "));
    }
    let [wale, course, radius] = SIZE;
    let rib = Knit::new(&KnitKind::Rib { knit: 2, purl: 1 }).unwrap();
    check(&rib.curves(wale, course, radius), &[vec![true, true, false]], 1.4 * radius, "rib");
}

/// The loop of a jersey of 14 wales and 20 courses per cm is about 2.7 mm long.
#[test]
fn loops_are_as_long_as_those_of_cloth() {
    let [wale, course, radius] = SIZE;
    let p = &Knit::new(&KnitKind::Jersey).unwrap().curves(wale, course, radius)[0].points_um;
    let step = |i: usize| {
        let mut q = p[(i + 1) % p.len()];
        if i + 1 == p.len() {
            q[0] += wale;
        }
        (0..3).map(|k| (q[k] - p[i][k]).powi(2)).sum::<f64>().sqrt()
    };
    let length: f64 = (0..p.len()).map(step).sum();
    println!("{length:.0} um");
    assert!((2400.0..3100.0).contains(&length), "{length}");
}

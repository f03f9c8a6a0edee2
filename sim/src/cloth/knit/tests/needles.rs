//! The bed against loops that are followed one by one through the letters of a chart.

use super::super::needles::{Cell, Loop, knit};
use super::Random;
use std::collections::BTreeMap;

/// A chart as letters.
struct Letters {
    /// `[course][wale]`.
    rows: Vec<Vec<char>>,
}

/// What becomes of a loop.
#[derive(Clone, Debug, PartialEq)]
struct Life {
    /// Wale at its own course and at each one after, up to that of its holder.
    wales: Vec<i64>,
    /// 1 if it is held by a knit stitch, -1 by a purl stitch.
    side: f64,
}

impl Letters {
    fn new(rows: &[String]) -> Letters {
        Letters { rows: rows.iter().rev().map(|row| row.chars().collect()).collect() }
    }

    fn at(&self, course: i64, wale: i64) -> char {
        let row = &self.rows[course.rem_euclid(self.rows.len() as i64) as usize];
        row[wale.rem_euclid(row.len() as i64) as usize]
    }

    /// By how many wales the loop of a place moves before a course.
    fn shift(&self, course: i64, wale: i64) -> i64 {
        let run = |mut at: i64, by: i64, letters: &str| {
            let mut n = 0;
            while letters.contains(self.at(course, at)) && n < 4 {
                (at, n) = (at + by, n + 1);
            }
            (n, at)
        };
        match self.at(course, wale) {
            '>' => 1,
            '<' => -1,
            // As many wales as there are loops on the other side.
            'R' | 'r' => run(run(wale, 1, "Rr").1, 1, "Ll").0,
            'L' | 'l' => -run(run(wale, -1, "Ll").1, -1, "Rr").0,
            _ => 0,
        }
    }

    fn life(&self, [course, wale]: [i64; 2]) -> Life {
        let (mut wales, mut at) = (vec![wale], course);
        loop {
            at += 1;
            let here = wales[wales.len() - 1];
            let next = here + self.shift(at, here);
            wales.push(next);
            match self.at(at, next) {
                'T' | 'M' => {}
                'P' => return Life { wales, side: -1.0 },
                _ => return Life { wales, side: 1.0 },
            }
        }
    }

    /// Whether the first loop lies in front of the second one, which the same stitch holds.
    fn is_front(&self, first: [i64; 2], second: [i64; 2]) -> bool {
        let lives = [first, second].map(|made| self.life(made));
        let place = |k: usize, at: i64| -> Option<i64> {
            let made = [first, second][k][0];
            usize::try_from(at - made).ok().and_then(|n| lives[k].wales.get(n)).copied()
        };
        let late = first[0].max(second[0]);
        // The first course from which on they are on one needle.
        let met = (late..).find(|at| place(0, *at) == place(1, *at)).unwrap();
        let is_made = [first[0] == met, second[0] == met];
        match is_made {
            // The yarn of a tuck lies behind the loops of a knit stitch.
            [true, false] => lives[0].side < 0.0,
            [false, true] => lives[0].side > 0.0,
            // The loop from the left lies in front of the one from the right, and that before what was there.
            _ => {
                let moved = [0, 1].map(|k| place(k, met).unwrap() - place(k, met - 1).unwrap());
                let rank = |by: i64| match by {
                    1 => 2,
                    -1 => 1,
                    _ => 0,
                };
                rank(moved[0]) > rank(moved[1])
            }
        }
    }
}

/// Which stitch holds which loops, for how long, where they are meanwhile and in which order they lie.
#[test]
fn needles_hold_what_loops_followed_one_by_one_say() {
    let mut random = Random(7);
    let (mut held, mut several, mut moved) = (0, 0, 0);
    for _ in 0..4000 {
        let (rows, chart) = random.chart(7);
        let letters = Letters::new(&rows);
        let knitted = knit(&chart);
        let name = rows.join(" ");
        // All loops that each stitch of the repeat holds, by following those of earlier courses.
        let mut holds = BTreeMap::<[i64; 2], Vec<[i64; 2]>>::new();
        let (wales, courses) = (chart.wales() as i64, chart.courses() as i64);
        for course in -6..courses {
            for wale in -40..wales + 40 {
                if letters.at(course, wale) != 'M' {
                    let life = letters.life([course, wale]);
                    let by = course + life.wales.len() as i64 - 1;
                    holds.entry([by, life.wales[life.wales.len() - 1]]).or_default().push([course, wale]);
                }
            }
        }
        for (course, row) in knitted.cells.iter().enumerate() {
            for (wale, cell) in row.iter().enumerate() {
                let at = [course as i64, wale as i64];
                let letter = letters.at(at[0], at[1]);
                assert_eq!(letter == 'M', matches!(cell, Cell::Float(_)), "{name}: {at:?}");
                let Cell::Loop(id) = cell else { continue };
                let of = &knitted.loops[*id];
                let life = letters.life(at);
                assert_eq!(of.made, at, "{name}");
                assert_eq!(of.places.iter().map(|p| p.wale).collect::<Vec<_>>(), life.wales, "{name}: {at:?}");
                assert_eq!(of.side, life.side, "{name}: {at:?}");
                let mut want = if letter == 'T' { Vec::new() } else { holds.get(&at).cloned().unwrap_or_default() };
                want.sort_by(|a, b| letters.is_front(*b, *a).cmp(&letters.is_front(*a, *b)));
                // A loop of the bed is one of the repeat; it came from the wale that its last place says.
                let known = |id: &usize| -> [i64; 2] {
                    let of: &Loop = &knitted.loops[*id];
                    [of.made[0], of.made[1] + at[1] - of.places[of.places.len() - 1].wale]
                };
                assert_eq!(of.holds.iter().map(known).collect::<Vec<_>>(), want, "{name}: {at:?}");
                assert_eq!(of.is_open, want.is_empty(), "{name}: {at:?}");
                held += usize::from(life.wales.len() > 2);
                several += usize::from(want.len() > 1);
                moved += usize::from(life.wales[0] != life.wales[life.wales.len() - 1]);
            }
        }
    }
    println!("{held} loops held longer, {moved} moved, {several} stitches of several loops");
    assert!(held > 1000 && several > 1000 && moved > 1000);
}

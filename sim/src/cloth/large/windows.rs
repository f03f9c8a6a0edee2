//! Neighborhoods of a draft: crossings about which the same yarns are on top.

use plywave_textile::Draft;
use std::collections::HashMap;

/// Largest reach of a window in crossings: its crossings fit into a word.
pub const MAX_REACH: usize = 3;

/// The window of every crossing of a draft. Crossings with equal windows have the same number.
pub struct Windows {
    ends: usize,
    /// `[pick][end]`: number of the window.
    of: Vec<u32>,
    count: usize,
}

impl Windows {
    /// The windows that reach this many crossings to each side, 3 at most. Numbers follow the first
    /// occurrence by picks, then by ends.
    pub fn new(draft: &Draft, reach: usize) -> Windows {
        let (ends, picks, reach) = (draft.ends(), draft.picks(), reach.min(MAX_REACH));
        let side = 2 * reach + 1;
        let mut numbers: HashMap<u64, u32> = HashMap::new();
        let mut of = Vec::with_capacity(ends * picks);
        for pick in 0..picks {
            for end in 0..ends {
                let mut key = 0u64;
                for i in 0..side * side {
                    let at = |at: usize, by: usize, count: usize| (at + by + MAX_REACH * count - reach) % count;
                    key |= u64::from(draft.up(at(pick, i / side, picks), at(end, i % side, ends))) << i;
                }
                let next = numbers.len() as u32;
                of.push(*numbers.entry(key).or_insert(next));
            }
        }
        Windows { ends, of, count: numbers.len() }
    }

    /// Number of the window about a crossing.
    pub fn at(&self, pick: usize, end: usize) -> usize {
        self.of[pick * self.ends + end] as usize
    }

    /// Number of different windows.
    pub fn count(&self) -> usize {
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A weave has as many windows as crossings in its minimal cell. In a random draft equal numbers mean
    /// equal windows, compared crossing by crossing.
    #[test]
    fn windows_are_those_of_the_draft() {
        for (draft, count) in [(Draft::plain(), 2), (Draft::satin(5, 2).unwrap(), 5), (Draft::twill(2, 2).unwrap(), 4)]
        {
            let wide = Draft::from_fn(3 * draft.picks(), 2 * draft.ends(), |pick, end| {
                draft.up(pick % draft.picks(), end % draft.ends())
            });
            assert_eq!(Windows::new(&wide.unwrap(), 3).count(), count);
        }
        let mut state = 7u64;
        let draft = Draft::from_fn(5, 60, |_, _| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 61 < 3
        });
        let draft = draft.unwrap();
        for reach in 1..=2 {
            let windows = Windows::new(&draft, reach);
            let window = |pick: usize, end: usize| -> Vec<bool> {
                let r = reach as i64;
                let up = |i: i64, k: i64| {
                    draft.up((pick as i64 + i).rem_euclid(5) as usize, (end as i64 + k).rem_euclid(60) as usize)
                };
                (-r..=r).flat_map(|i| (-r..=r).map(move |k| (i, k))).map(|(i, k)| up(i, k)).collect()
            };
            let all: Vec<(usize, usize)> = (0..5).flat_map(|pick| (0..60).map(move |end| (pick, end))).collect();
            for a in &all {
                for b in &all {
                    let is_same = windows.at(a.0, a.1) == windows.at(b.0, b.1);
                    assert_eq!(is_same, window(a.0, a.1) == window(b.0, b.1), "{a:?} {b:?}");
                }
            }
        }
    }
}

//! The draft: which yarn is on top at each crossing of one repeat, one bit each. There are constructors for
//! plain weave, twills, satins and hopsacks; others are read from rows of text.

/// Largest number of ends and of picks in a draft.
pub const MAX_THREADS: usize = 4096;

/// The two sets of yarns of a woven cloth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum YarnSet {
    /// Ends, along y.
    Warp,
    /// Picks, along x.
    Weft,
}

impl YarnSet {
    /// Warp, then weft: the order of every pair by set.
    pub const EACH: [YarnSet; 2] = [YarnSet::Warp, YarnSet::Weft];

    /// The other set.
    pub fn other(self) -> YarnSet {
        match self {
            YarnSet::Warp => YarnSet::Weft,
            YarnSet::Weft => YarnSet::Warp,
        }
    }

    /// Name as in a cloth spec.
    pub fn name(self) -> &'static str {
        match self {
            YarnSet::Warp => "warp",
            YarnSet::Weft => "weft",
        }
    }
}

/// One repeat of a weave, `[picks][ends]`: the warp is on top where a bit is set, seen from the face. Pick 0
/// is woven first and has the smallest y; end 0 has the smallest x.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Draft {
    ends: usize,
    picks: usize,
    /// Words per row; each row starts at a new word.
    stride: usize,
    bits: Vec<u64>,
}

impl Draft {
    /// A draft from `up(pick, end)`. `None` if a side is 0 or above [`MAX_THREADS`].
    pub fn from_fn(picks: usize, ends: usize, mut up: impl FnMut(usize, usize) -> bool) -> Option<Draft> {
        if !(1..=MAX_THREADS).contains(&picks) || !(1..=MAX_THREADS).contains(&ends) {
            return None;
        }
        let stride = ends.div_ceil(64);
        let mut bits = vec![0u64; stride * picks];
        for pick in 0..picks {
            for end in 0..ends {
                bits[pick * stride + end / 64] |= u64::from(up(pick, end)) << (end % 64);
            }
        }
        Some(Draft { ends, picks, stride, bits })
    }

    /// Plain weave: over one, under one.
    pub fn plain() -> Draft {
        Draft { ends: 2, picks: 2, stride: 1, bits: vec![0b01, 0b10] }
    }

    /// Twill: each end passes over `up` picks and under `down`, its neighbor at larger x one pick later, so
    /// that diagonals rise with x (Z). `None` if a count is 0 or the repeat is above [`MAX_THREADS`].
    pub fn twill(up: usize, down: usize) -> Option<Draft> {
        if up == 0 || down == 0 || up > MAX_THREADS || down > MAX_THREADS {
            return None;
        }
        let n = up + down;
        Draft::from_fn(n, n, |pick, end| (pick + n - end) % n < up)
    }

    /// Satin of `n` ends: the warp is on top except at one crossing per pick, which moves by `step` ends from
    /// pick to pick. `None` unless n is 5 to [`MAX_THREADS`], and step is 2 to n - 2 and has no common factor
    /// with n; otherwise some end is never bound, or the weave is a twill.
    pub fn satin(n: usize, step: usize) -> Option<Draft> {
        if !(5..=MAX_THREADS).contains(&n) || !(2..=n - 2).contains(&step) || gcd(n, step) != 1 {
            return None;
        }
        Draft::from_fn(n, n, |pick, end| end != pick * step % n)
    }

    /// Hopsack, or basket: plain weave of groups of ends and picks. `None` for 0 and above half of
    /// [`MAX_THREADS`].
    pub fn hopsack(ends: usize, picks: usize) -> Option<Draft> {
        let sound = 1..=MAX_THREADS / 2;
        if !sound.contains(&ends) || !sound.contains(&picks) {
            return None;
        }
        Draft::from_fn(2 * picks, 2 * ends, |pick, end| pick / picks == end / ends)
    }

    /// Two layers of straight yarns with the warp above the weft at every crossing. This is no weave, since
    /// no yarn binds another.
    pub fn layers() -> Draft {
        Draft { ends: 1, picks: 1, stride: 1, bits: vec![1] }
    }

    /// Number of ends.
    pub fn ends(&self) -> usize {
        self.ends
    }

    /// Number of picks.
    pub fn picks(&self) -> usize {
        self.picks
    }

    /// Number of yarns of a set in the repeat.
    pub fn threads(&self, family: YarnSet) -> usize {
        match family {
            YarnSet::Warp => self.ends,
            YarnSet::Weft => self.picks,
        }
    }

    /// Whether the warp is on top where this pick and this end of the repeat cross. Indices beyond the repeat
    /// count as 0.
    #[inline]
    pub fn up(&self, pick: usize, end: usize) -> bool {
        let (pick, end) = (if pick < self.picks { pick } else { 0 }, if end < self.ends { end } else { 0 });
        self.bits[pick * self.stride + end / 64] >> (end % 64) & 1 == 1
    }

    /// The same weave in its shortest repeat.
    #[must_use]
    pub fn reduced(&self) -> Draft {
        let all = |is: &dyn Fn(usize, usize) -> bool| {
            (0..self.picks).all(|pick| (0..self.ends).all(|end| is(pick, end) == self.up(pick, end)))
        };
        let shortest = |count: usize, is_alike: &dyn Fn(usize) -> bool| {
            (1..count).find(|n| count.is_multiple_of(*n) && is_alike(*n)).unwrap_or(count)
        };
        let ends = shortest(self.ends, &|n| all(&|pick, end| self.up(pick, (end + n) % self.ends)));
        let picks = shortest(self.picks, &|n| all(&|pick, end| self.up((pick + n) % self.picks, end)));
        Draft::from_fn(picks, ends, |pick, end| self.up(pick, end)).unwrap_or_else(|| self.clone())
    }

    /// Memory of the crossings in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.bits.len() * size_of::<u64>()
    }

    /// A yarn that is on top, or below, at all its crossings, so that no yarn binds it: its set, its index in
    /// the repeat, and whether it is on top. `None` for [`Draft::layers`], which binds no yarn on purpose.
    pub fn unbound(&self) -> Option<(YarnSet, usize, bool)> {
        if *self == Draft::layers() {
            return None;
        }
        // Ends that are up at some pick, and ends that are up at all picks.
        let (mut some, mut all) = (vec![0u64; self.stride], vec![u64::MAX; self.stride]);
        for (pick, row) in self.bits.chunks_exact(self.stride).enumerate() {
            let count: u32 = row.iter().map(|w| w.count_ones()).sum();
            if count == 0 || count as usize == self.ends {
                return Some((YarnSet::Weft, pick, count == 0));
            }
            for (k, word) in row.iter().enumerate() {
                some[k] |= word;
                all[k] &= word;
            }
        }
        let bit = |words: &[u64], end: usize| words[end / 64] >> (end % 64) & 1 == 1;
        (0..self.ends).find_map(|end| match (bit(&some, end), bit(&all, end)) {
            (true, true) => Some((YarnSet::Warp, end, true)),
            (false, _) => Some((YarnSet::Warp, end, false)),
            _ => None,
        })
    }

    /// Number of crossings at which a draft of the same size has the other yarn on top.
    pub fn differences(&self, other: &Draft) -> usize {
        self.bits.iter().zip(&other.bits).map(|(a, b)| (a ^ b).count_ones() as usize).sum()
    }

    /// Share of the crossings with the warp on top.
    pub fn warp_share(&self) -> f64 {
        let up: u64 = self.bits.iter().map(|w| u64::from(w.count_ones())).sum();
        up as f64 / (self.ends * self.picks) as f64
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows as drawn, with the last pick at the top.
    fn drawn(draft: &Draft) -> Vec<String> {
        let row = |pick: usize| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
        (0..draft.picks()).rev().map(row).collect()
    }

    #[test]
    fn weaves_are_those_of_the_books() {
        assert_eq!(drawn(&Draft::plain()), [".X", "X."]);
        assert_eq!(drawn(&Draft::twill(3, 1).unwrap()), [".XXX", "XXX.", "XX.X", "X.XX"]);
        assert_eq!(drawn(&Draft::twill(1, 1).unwrap()), drawn(&Draft::plain()));
        assert_eq!(drawn(&Draft::satin(5, 2).unwrap()), ["XXX.X", "X.XXX", "XXXX.", "XX.XX", ".XXXX"]);
        assert_eq!(drawn(&Draft::hopsack(2, 2).unwrap()), ["..XX", "..XX", "XX..", "XX.."]);
    }

    #[test]
    fn satins_bind_each_yarn_once_and_never_beside_a_neighbor() {
        for n in 5..40 {
            for step in 0..n + 2 {
                let sound = (2..=n - 2).contains(&step) && gcd(n, step) == 1;
                let Some(draft) = Draft::satin(n, step) else {
                    assert!(!sound, "{n}/{step}");
                    continue;
                };
                assert!(sound && draft.unbound().is_none(), "{n}/{step}");
                for k in 0..n {
                    assert_eq!((0..n).filter(|&i| !draft.up(k, i)).count(), 1, "{n}/{step}: pick {k}");
                    assert_eq!((0..n).filter(|&i| !draft.up(i, k)).count(), 1, "{n}/{step}: end {k}");
                    for end in 0..n {
                        assert!(draft.up(k, end) || draft.up((k + 1) % n, (end + 1) % n), "{n}/{step}: a twill line");
                    }
                }
            }
        }
        // There is no satin of six ends: 2, 3 and 4 share a factor with it.
        assert!((0..7).all(|step| Draft::satin(6, step).is_none()));
        assert!(Draft::satin(4, 1).is_none() && Draft::satin(3, 2).is_none() && Draft::satin(0, 0).is_none());
    }

    #[test]
    fn drafts_are_reduced_to_their_shortest_repeat() {
        let twill = Draft::twill(2, 1).unwrap();
        let large = Draft::from_fn(12, 9, |pick, end| twill.up(pick % 3, end % 3)).unwrap();
        assert_eq!(large.reduced(), twill);
        // One different crossing prevents the reduction.
        let marked = Draft::from_fn(12, 9, |pick, end| (pick, end) == (7, 4) || twill.up(pick % 3, end % 3)).unwrap();
        let differs = !twill.up(1, 1);
        assert_eq!(marked.reduced() == marked, differs);
        assert_eq!(Draft::plain().reduced(), Draft::plain());
    }

    #[test]
    fn unbound_yarns_are_found() {
        let of = |rows: &[&str]| {
            let up = |pick: usize, end: usize| rows[rows.len() - 1 - pick].as_bytes()[end] == b'X';
            Draft::from_fn(rows.len(), rows[0].len(), up).unwrap().unbound()
        };
        assert_eq!(of(&["X.", ".X"]), None);
        assert_eq!(of(&["X.", "XX"]), Some((YarnSet::Weft, 0, false)));
        assert_eq!(of(&["..", "X."]), Some((YarnSet::Weft, 1, true)));
        assert_eq!(of(&["XX.", "X.X"]), Some((YarnSet::Warp, 0, true)));
        assert_eq!(of(&["X..", ".X."]), Some((YarnSet::Warp, 2, false)));
        let mut wide = [".".repeat(200), "X".repeat(200)];
        assert_eq!(of(&[&wide[0], &wide[1]]), Some((YarnSet::Weft, 0, false)));
        wide[0].replace_range(130..131, "X");
        wide[1].replace_range(131..132, ".");
        assert_eq!(of(&[&wide[0], &wide[1]]), Some((YarnSet::Warp, 130, true)));
    }

    /// Reference implementation with a matrix of booleans.
    #[test]
    fn bits_are_those_of_a_plain_matrix() {
        for (picks, ends) in [(1, 1), (3, 63), (5, 64), (2, 65), (129, 200)] {
            let up = |p: usize, e: usize| (p * 7919 + e * 104_729) % 97 < 41;
            let draft = Draft::from_fn(picks, ends, up).unwrap();
            let mut count = 0;
            for p in 0..picks {
                for e in 0..ends {
                    assert_eq!(draft.up(p, e), up(p, e), "{p} {e}");
                    count += usize::from(up(p, e));
                }
            }
            assert!((draft.warp_share() - count as f64 / (picks * ends) as f64).abs() < 1e-15);
            assert_eq!(draft.up(picks, ends), draft.up(0, 0));
        }
        assert!(Draft::from_fn(0, 3, |_, _| true).is_none() && Draft::from_fn(1, 4097, |_, _| true).is_none());
    }

    #[test]
    fn a_crossing_takes_a_bit() {
        for (n, bytes) in [(2, 16), (64, 512), (1024, 128 << 10), (4096, 2 << 20)] {
            assert_eq!(Draft::from_fn(n, n, |p, e| p % 2 == e % 2).unwrap().memory_bytes(), bytes);
        }
    }
}

//! Whether a draft hangs together (C. R. J. Clapham, "When a fabric hangs together", Bulletin of the London
//! Mathematical Society 12, 1980), the layers into which it falls apart, and yarns that nothing binds.
//!
//! At each crossing one of two yarns is above. A set of yarns can be lifted off if none of them passes below
//! a yarn outside of the set. Take s of E ends and t of P picks: at s P + t E - s t crossings one of them
//! crosses any yarn. The set can be lifted off if a yarn of the set is above at all of these; then the counts
//! "crossings at which this yarn is above" of its yarns add up to that number. A yarn of a higher layer is
//! above at no fewer crossings than one of a lower layer. So ends and picks are sorted by their counts, and
//! the candidate sets are the first s and the first t of them. For each s only few t are possible: the P - t
//! picks that remain are below each of the s ends, and the ends that remain are above none of the t picks.

use crate::weave::draft::Draft;
use crate::weave::draft::YarnSet;
use crate::weave::names::{numbered, words};

/// Yarns of a draft that can be lifted off those below: a cloth or, if they are of one set only, loose yarns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Its ends, in ascending order from 0.
    pub ends: Vec<usize>,
    /// Its picks, in ascending order from 0.
    pub picks: Vec<usize>,
}

impl Layer {
    /// Whether its yarns bind each other.
    pub fn is_cloth(&self) -> bool {
        !self.ends.is_empty() && !self.picks.is_empty()
    }

    /// A message about the layers of a draft, if there are several. `numbers` are the numbers of its ends and
    /// picks in the file, from 0.
    pub(crate) fn note(layers: &[Layer], numbers: &[Vec<usize>; 2]) -> Option<String> {
        let [top, _, ..] = layers else { return None };
        let cloths = layers.iter().filter(|layer| layer.is_cloth()).count();
        let loose: usize = layers.iter().filter(|l| !l.is_cloth()).map(|l| l.ends.len() + l.picks.len()).sum();
        let parts = match (cloths, loose) {
            (_, 0) => format!("{cloths} cloths"),
            (1, 1) => "a cloth and a loose yarn".into(),
            (1, _) => format!("a cloth and {loose} loose yarns"),
            (_, 1) => format!("{cloths} cloths and a loose yarn"),
            _ => format!("{cloths} cloths and {loose} loose yarns"),
        };
        let named = |family: YarnSet, threads: &[usize]| {
            let threads: Vec<usize> = threads.iter().map(|at| numbers[family as usize][*at] + 1).collect();
            (!threads.is_empty()).then(|| numbered(words(family), &threads))
        };
        let on_top = [named(YarnSet::Warp, &top.ends), named(YarnSet::Weft, &top.picks)];
        let on_top: Vec<String> = on_top.into_iter().flatten().collect();
        Some(format!(
            "the draft falls apart into {parts} that no yarn joins (Clapham 1980), on top {}; all are shaded as one layer",
            on_top.join(" with ")
        ))
    }
}

impl Draft {
    /// The layers into which the draft falls apart, the top one first; a single one if it hangs together.
    pub fn layers_apart(&self) -> Vec<Layer> {
        let (ends, picks) = (self.ends(), self.picks());
        // Number of crossings at which each yarn is above.
        let mut above = [vec![0usize; ends], vec![0usize; picks]];
        for pick in 0..picks {
            for end in 0..ends {
                let up = self.up(pick, end);
                above[0][end] += usize::from(up);
                above[1][pick] += usize::from(!up);
            }
        }
        let order = [0, 1].map(|k| {
            let mut order: Vec<usize> = (0..above[k].len()).collect();
            order.sort_by_key(|at| (std::cmp::Reverse(above[k][*at]), *at));
            order
        });
        // Number of crossings at which the first s ends, and the first t picks, are above.
        let sums = [0, 1].map(|k| {
            let mut sum = vec![0];
            sum.extend(order[k].iter().scan(0, |total, at| {
                *total += above[k][*at];
                Some(*total)
            }));
            sum
        });
        let mut layers = Vec::new();
        let mut last = (0, 0);
        for s in 0..=ends {
            // The remaining picks are below each of the first s ends, and the remaining ends are above none
            // of the lifted picks.
            let max_remaining = if s == 0 { picks } else { above[0][order[0][s - 1]] };
            let min_remaining = if s == ends { 0 } else { above[0][order[0][s]] };
            for t in picks - max_remaining..=picks - min_remaining {
                let lifts = sums[0][s] + sums[1][t] == s * picks + t * ends - s * t;
                if !lifts || (s, t) == (0, 0) {
                    continue;
                }
                let mut layer = Layer { ends: order[0][last.0..s].to_vec(), picks: order[1][last.1..t].to_vec() };
                layer.ends.sort_unstable();
                layer.picks.sort_unstable();
                layers.push(layer);
                last = (s, t);
            }
        }
        layers
    }

    /// A message about a draft that falls apart into layers; `None` for one that hangs together.
    pub fn layers_note(&self) -> Option<String> {
        let numbers = [self.ends(), self.picks()].map(|n| (0..n).collect());
        Layer::note(&self.layers_apart(), &numbers)
    }

    /// Repeatedly removes yarns that are above, or below, all others that remain, until there is none.
    /// `is_retained` marks the remaining ends and picks. Returns set, index and whether it is above for each
    /// removed yarn, in the order of removal.
    pub(crate) fn peel(&self, is_retained: &mut [Vec<bool>; 2]) -> Vec<(YarnSet, usize, bool)> {
        let up = |family: YarnSet, thread: usize, across: usize| match family {
            YarnSet::Warp => self.up(across, thread),
            YarnSet::Weft => !self.up(thread, across),
        };
        let mut remaining = [0, 1].map(|k| is_retained[k].iter().filter(|retained| **retained).count());
        // Number of crossings with remaining yarns at which each yarn is above.
        let mut above = YarnSet::EACH.map(|family| {
            let across: Vec<usize> =
                (0..self.threads(family.other())).filter(|a| is_retained[family.other() as usize][*a]).collect();
            (0..self.threads(family))
                .map(|t| across.iter().filter(|a| up(family, t, **a)).count())
                .collect::<Vec<usize>>()
        });
        let mut removed = Vec::new();
        loop {
            let before = removed.len();
            for family in YarnSet::EACH {
                let (k, other) = (family as usize, family.other() as usize);
                for thread in 0..self.threads(family) {
                    let count = above[k][thread];
                    if !is_retained[k][thread] || (count > 0 && count < remaining[other]) {
                        continue;
                    }
                    is_retained[k][thread] = false;
                    remaining[k] -= 1;
                    for across in 0..self.threads(family.other()) {
                        above[other][across] -=
                            usize::from(is_retained[other][across] && up(family.other(), across, thread));
                    }
                    removed.push((family, thread, count > 0));
                }
            }
            if removed.len() == before {
                return removed;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&str]) -> Draft {
        let up = |pick: usize, end: usize| rows[pick].as_bytes()[end] == b'X';
        Draft::from_fn(rows.len(), rows[0].len(), up).unwrap()
    }

    /// Computes the layers by definition: yarns that are above each other, directly or by way of others,
    /// belong to one layer, and layers are sorted from top to bottom.
    fn by_reach(draft: &Draft) -> Vec<Layer> {
        let (ends, n) = (draft.ends(), draft.ends() + draft.picks());
        let mut reach = vec![vec![false; n]; n];
        for pick in 0..draft.picks() {
            for end in 0..ends {
                let up = draft.up(pick, end);
                (reach[end][ends + pick], reach[ends + pick][end]) = (up, !up);
            }
        }
        for via in 0..n {
            for from in 0..n {
                for to in 0..n {
                    reach[from][to] |= reach[from][via] && reach[via][to];
                }
            }
        }
        let mut layers: Vec<(usize, Layer)> = Vec::new();
        for yarn in 0..n {
            if (0..yarn).any(|before| reach[yarn][before] && reach[before][yarn]) {
                continue;
            }
            let all: Vec<usize> = (0..n).filter(|y| *y == yarn || (reach[yarn][*y] && reach[*y][yarn])).collect();
            let picks = all.iter().filter(|y| **y >= ends).map(|y| y - ends).collect();
            let layer = Layer { ends: all.iter().copied().filter(|y| *y < ends).collect(), picks };
            layers.push(((0..n).filter(|to| reach[yarn][*to]).count(), layer));
        }
        // A higher yarn reaches more yarns.
        layers.sort_by_key(|(below, _)| std::cmp::Reverse(*below));
        layers.into_iter().map(|(_, layer)| layer).collect()
    }

    /// All drafts of up to 4 x 3 and 3 x 4 yarns agree with the definition. Loose yarns side by side may be
    /// in either order.
    #[test]
    fn layers_are_those_of_the_definition() {
        let sorted = |layers: &[Layer]| {
            let mut list: Vec<_> = layers.iter().map(|l| (l.ends.clone(), l.picks.clone())).collect();
            list.sort();
            list
        };
        for (picks, ends) in [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (2, 3), (3, 3), (4, 3), (3, 4)] {
            for bits in 0u32..1 << (picks * ends) {
                let draft = Draft::from_fn(picks, ends, |pick, end| bits >> (pick * ends + end) & 1 == 1).unwrap();
                let (got, want) = (draft.layers_apart(), by_reach(&draft));
                assert_eq!(sorted(&got), sorted(&want), "{picks} x {ends}: {bits:b}");
                // From top to bottom, no yarn lies above a yarn of a higher layer.
                for (k, layer) in got.iter().enumerate() {
                    for lower in &got[k + 1..] {
                        assert!(layer.ends.iter().all(|e| lower.picks.iter().all(|p| draft.up(*p, *e))), "{bits:b}");
                        assert!(layer.picks.iter().all(|p| lower.ends.iter().all(|e| !draft.up(*p, *e))), "{bits:b}");
                    }
                }
                let mut retained = [vec![true; ends], vec![true; picks]];
                let removed = draft.peel(&mut retained);
                assert_eq!(removed.len(), retained.iter().flatten().filter(|retained| !**retained).count(), "{bits:b}");
                assert_eq!(removed.is_empty(), ends > 0 && unbound(&draft).is_none(), "{bits:b}");
            }
        }
    }

    /// The result agrees with [`Draft::unbound`], which accepts two layers.
    fn unbound(draft: &Draft) -> Option<usize> {
        if *draft == Draft::layers() { Some(0) } else { draft.unbound().map(|(_, thread, _)| thread) }
    }

    #[test]
    fn weaves_hang_together_and_double_cloths_do_not() {
        for draft in
            [Draft::plain(), Draft::twill(3, 1).unwrap(), Draft::satin(8, 3).unwrap(), Draft::hopsack(3, 3).unwrap()]
        {
            assert_eq!(draft.layers_apart().len(), 1);
        }
        // Two plain weaves, three of them, and one stitched to the other.
        let two = of(&["X...", "XXX.", "..X.", "X.XX"]).layers_apart();
        assert_eq!(two, [Layer { ends: vec![0, 2], picks: vec![0, 2] }, Layer { ends: vec![1, 3], picks: vec![1, 3] }]);
        let plies = |n: usize| {
            Draft::from_fn(2 * n, 2 * n, move |pick, end| match (end % n).cmp(&(pick % n)) {
                std::cmp::Ordering::Less => true,
                std::cmp::Ordering::Equal => (pick / n + end / n).is_multiple_of(2),
                std::cmp::Ordering::Greater => false,
            })
        };
        for n in [1, 2, 3, 7, 100] {
            let layers = plies(n).unwrap().layers_apart();
            assert_eq!(layers.len(), n);
            assert!(layers.iter().enumerate().all(|(k, l)| l.ends == [k, n + k] && l.picks == [k, n + k]));
        }
        assert_eq!(of(&["XX..", "XXX.", "..X.", "X.XX"]).layers_apart().len(), 1);
        let numbers = [(0..4).collect(), (0..4).collect()];
        assert_eq!(Layer::note(&two[..1], &numbers), None);
        // An end between two cloths that neither of them binds.
        let three = of(&["X....", "XXX.X", "..X..", "X.XXX"]).layers_apart();
        assert_eq!(three[1], Layer { ends: vec![4], picks: vec![] });
        let said = Layer::note(&three, &[(0..5).collect(), (0..4).collect()]).unwrap();
        assert!(
            said.contains("into 2 cloths and a loose yarn") && said.contains("on top ends 1 and 3 with picks 1 and 3")
        );
    }

    /// Yarns are removed one after the other down a staircase, in time linear in the number of crossings.
    #[test]
    fn staircases_are_peeled() {
        let n = 2000;
        let stairs = Draft::from_fn(n, n, |pick, end| end < pick).unwrap();
        let mut retained = [vec![true; n], vec![true; n]];
        assert_eq!(stairs.peel(&mut retained).len(), 2 * n);
        assert_eq!(stairs.layers_apart().len(), 2 * n);
    }
}

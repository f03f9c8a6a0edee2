//! Binding of long floats, as programs for jacquard weaving do: a crossing of a float that is too long is
//! turned over, so that the yarn goes to the other side of the cloth there.
//!
//! A limit of n yarns holds for wefts. An end passes n rows of picks at most, of all wefts in a row.
//!
//! A crossing is turned only towards a fixed checkerboard, that of [`Draft::plain`]. So none is turned twice
//! and the process ends; three crossings in a row have one that differs from the checkerboard, so no float
//! longer than a limit of 2 or more remains; and binding points of one side never lie side by side along a
//! pick, since they are all of one color of the checkerboard (but where a repeat of odd size closes). Among
//! these crossings the one of least [`cost`] is turned: away from other binding points, without a long float
//! of the crossing yarn, and on the points of a satin, so that wide areas of floats look even.

use crate::weave::floats::runs;
use crate::{Draft, YarnSet};

/// Smallest limit of floats that always can be kept.
pub(crate) const MIN_LIMIT: usize = 2;

/// Costs of turning a crossing, in units of a step along the float away from its middle. Chosen so that each
/// outweighs the following ones: a crossing yarn that nothing binds any more, a float of it that is too long,
/// a binding point beside it, a weft other than the ground's on the face, a second binding point where one is
/// enough, a binding point at a corner, a place off the satin.
const ENDLESS: usize = 1_000_000;
const LONG: usize = 10_000;
const BESIDE: usize = 1_000;
const EXTRA_WEFT: usize = 400;
const CORNER: usize = 100;
const SECOND: usize = 200;
const OFF_SATIN: usize = 3;

/// The crossings of a draft while they are changed: `[pick][end]`, whether the warp is above. Picks are those
/// of `wefts` wefts in turn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Crossings {
    pub(crate) ends: usize,
    pub(crate) picks: usize,
    pub(crate) wefts: usize,
    pub(crate) up: Vec<bool>,
}

impl Crossings {
    pub(crate) fn from_fn(
        [picks, ends]: [usize; 2],
        wefts: usize,
        mut up: impl FnMut(usize, usize) -> bool,
    ) -> Crossings {
        let all = (0..picks * ends).map(|at| up(at / ends, at % ends)).collect();
        Crossings { ends, picks, wefts, up: all }
    }

    pub(crate) fn up(&self, pick: usize, end: usize) -> bool {
        self.up[pick * self.ends + end]
    }

    pub(crate) fn draft(&self) -> Option<Draft> {
        Draft::from_fn(self.picks, self.ends, |pick, end| self.up(pick, end))
    }

    fn threads(&self, set: YarnSet) -> usize {
        match set {
            YarnSet::Warp => self.ends,
            YarnSet::Weft => self.picks,
        }
    }

    /// Value of the fixed checkerboard: that of a plain weave of each weft. Along an end the picks of a row
    /// are alike.
    fn board(&self, pick: usize, end: usize) -> bool {
        (pick / self.wefts + end).is_multiple_of(2)
    }

    /// The longest float that is accepted, in yarns of the other set.
    fn longest(&self, set: YarnSet, limit: usize) -> usize {
        match set {
            YarnSet::Warp => (limit + 1) * self.wefts - 1,
            YarnSet::Weft => limit,
        }
    }

    /// Number of crossings in a row, up to `limit`, that have a value, from a crossing onwards by steps of
    /// `by` picks or ends, without the crossing itself.
    fn reach(&self, [pick, end]: [usize; 2], by: [usize; 2], value: bool, limit: usize) -> usize {
        let at = |k: usize| self.up((pick + k * by[0]) % self.picks, (end + k * by[1]) % self.ends);
        (1..=limit).take_while(|k| at(*k) == value).count()
    }
}

/// The satin on whose points floats are bound first.
struct Satin {
    ends: usize,
    step: usize,
}

impl Satin {
    /// The satin of the most ends, an even number, whose floats are not longer than the limit. With an even
    /// number of ends all of its points have one color of the checkerboard.
    fn within(limit: usize) -> Satin {
        let ends = limit + 1 - (limit + 1) % 2;
        // Points spread best with a step near the golden section of the ends.
        let distance = |step: &usize| (step * 1000).abs_diff(ends * 382);
        let step = (1..ends).filter(|step| gcd(ends, *step) == 1).min_by_key(distance).unwrap_or(1);
        Satin { ends, step }
    }

    /// Whether a crossing is a point of it at which a float with this value is bound.
    fn has(&self, crossings: &Crossings, [pick, end]: [usize; 2], value: bool) -> bool {
        let (row, weft) = (pick / crossings.wefts, pick % crossings.wefts);
        // Wefts are bound in turn along an end, on the color of the checkerboard that differs from the value.
        let shift = weft * self.ends / crossings.wefts / 2 * 2 + usize::from(value);
        end % self.ends == (row + shift) * self.step % self.ends
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Turns crossings until no yarn floats over more than `limit` others, [`MIN_LIMIT`] or more, on either side,
/// and each yarn is bound. Returns the turned crossings, as pick and end, in their order. The draft must have
/// two ends and two picks.
pub(crate) fn bind(crossings: &mut Crossings, limit: usize) -> Vec<[usize; 2]> {
    let satin = Satin::within(limit);
    let mut turned = Vec::new();
    let mut is_due = YarnSet::EACH.map(|set| vec![true; crossings.threads(set)]);
    loop {
        let before = turned.len();
        for set in YarnSet::EACH {
            let across = crossings.threads(set.other());
            for thread in 0..crossings.threads(set) {
                if !std::mem::take(&mut is_due[set as usize][thread]) {
                    continue;
                }
                let at = |place: usize| match set {
                    YarnSet::Warp => [place % across, thread],
                    YarnSet::Weft => [thread, place % across],
                };
                let found = runs(across, |place| crossings.up(at(place)[0], at(place)[1]));
                let longest = crossings.longest(set, limit);
                for (from, length, value) in found.into_iter().filter(|(_, n, _)| *n > longest || *n == across) {
                    let first = turned.len();
                    bind_float(crossings, &satin, limit, set, &at, [from, length], value, &mut turned);
                    for [pick, end] in &turned[first..] {
                        let other = if set == YarnSet::Warp { *pick } else { *end };
                        is_due[set.other() as usize][other] = true;
                        // The floats beside a binding point grow by one.
                        is_due[set as usize][thread] = true;
                    }
                }
            }
        }
        if turned.len() == before {
            return turned;
        }
    }
}

/// Binds one float, from a place on over a length. `at` gives pick and end of a place.
fn bind_float(
    crossings: &mut Crossings,
    satin: &Satin,
    limit: usize,
    set: YarnSet,
    at: &dyn Fn(usize) -> [usize; 2],
    [mut from, mut length]: [usize; 2],
    value: bool,
    turned: &mut Vec<[usize; 2]>,
) {
    let mut is_endless = length == crossings.threads(set.other());
    let longest = crossings.longest(set, limit);
    while is_endless || length > longest {
        // Places that leave a float within the limit behind them. Floats of equal length are the aim.
        let places = if is_endless { length } else { longest + 1 };
        let binders = length / (longest + 1);
        let aim = (length - binders) / (binders + 1);
        let cost = |place: usize| {
            let crossing = at(from + place);
            let off = if satin.has(crossings, crossing, value) { 0 } else { OFF_SATIN + place.abs_diff(aim) };
            let needs_second = binders == 1 && !is_endless && length - place - 1 > longest;
            (off + usize::from(needs_second) * SECOND + cost(crossings, set, crossing, limit), place)
        };
        let may_turn = |place: &usize| {
            let [pick, end] = at(from + place);
            crossings.board(pick, end) != value
        };
        let Some(place) = (0..places).filter(may_turn).min_by_key(|place| cost(*place)) else { return };
        let [pick, end] = at(from + place);
        crossings.up[pick * crossings.ends + end] = !value;
        turned.push([pick, end]);
        from += place + 1;
        length -= if is_endless { 1 } else { place + 1 };
        is_endless = false;
    }
}

/// Cost of turning a crossing over, but for its place along the float.
fn cost(crossings: &Crossings, set: YarnSet, [pick, end]: [usize; 2], limit: usize) -> usize {
    let (ends, picks, wefts) = (crossings.ends, crossings.picks, crossings.wefts);
    let turned = !crossings.up(pick, end);
    let along = match set {
        YarnSet::Warp => [0, 1],
        YarnSet::Weft => [1, 0],
    };
    let back = [(picks - along[0]) % picks, (ends - along[1]) % ends];
    let across = crossings.threads(set);
    let longest = crossings.longest(set.other(), limit);
    let most = (longest + 1).min(across - 1);
    let reach = |by| crossings.reach([pick, end], by, turned, most);
    let float = reach(along) + 1 + reach(back);
    let mut cost = match float {
        _ if float >= across => ENDLESS,
        _ if float > longest => LONG + float,
        _ => 0,
    };
    // The nearest picks of the same weft.
    let near = |by_pick: usize, by_end: usize| {
        usize::from(crossings.up((pick + by_pick) % picks, (end + by_end) % ends) == turned)
    };
    let (before, after) = (picks - wefts % picks, wefts);
    cost += BESIDE * (near(before, 0) + near(after, 0) + near(0, 1) + near(0, ends - 1));
    cost += CORNER * (near(before, 1) + near(after, 1) + near(before, ends - 1) + near(after, ends - 1));
    cost + if set == YarnSet::Warp && pick % wefts > 0 { EXTRA_WEFT } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weave::floats::longest_floats;
    use proptest::prelude::*;

    /// Whether a crossing lies in a float over more than the limit, along its end or its pick, or in an
    /// endless one: counted crossing by crossing.
    fn is_in_long_float(crossings: &Crossings, [pick, end]: [usize; 2], limit: usize) -> bool {
        let value = crossings.up(pick, end);
        let rows = (limit + 1) * crossings.wefts - 1;
        [(crossings.ends, 0, limit), (crossings.picks, 1, rows)].into_iter().any(|(count, k, longest)| {
            let at = |by: usize| match k {
                0 => crossings.up(pick, (end + by) % count),
                _ => crossings.up((pick + by) % count, end),
            };
            let after = (1..count).take_while(|by| at(*by) == value).count();
            let before = (1..count).take_while(|by| at(count - by) == value).count();
            after + 1 == count || after + before + 1 > longest
        })
    }

    /// Replays the turned crossings: each one lay in a float that was too long at that time, none is turned
    /// twice, and all others are as before.
    fn check(raw: &Crossings, limit: usize) -> Vec<[usize; 2]> {
        let mut bound = raw.clone();
        let turned = bind(&mut bound, limit);
        let mut replayed = raw.clone();
        for crossing in &turned {
            assert!(is_in_long_float(&replayed, *crossing, limit), "{crossing:?} was in no long float");
            let at = crossing[0] * raw.ends + crossing[1];
            assert_eq!(replayed.up[at], raw.up[at], "{crossing:?} is turned twice");
            replayed.up[at] = !replayed.up[at];
        }
        assert_eq!(replayed, bound);
        for at in 0..raw.up.len() {
            let crossing = [at / raw.ends, at % raw.ends];
            assert!(!is_in_long_float(&bound, crossing, limit), "{crossing:?} is in a long float");
        }
        let draft = bound.draft().unwrap();
        assert_eq!(draft.unbound(), None);
        let [warp, weft] = longest_floats(&draft).map(|f| f.length);
        assert!(warp < (limit + 1) * raw.wefts && weft <= limit);
        // Binding points of one side do not lie side by side along a pick, but at the seam of an odd repeat.
        for [pick, end] in &turned {
            let next = [*pick, (end + 1) % raw.ends];
            let is_seam = end + 1 == raw.ends && raw.ends % 2 == 1;
            let is_same = bound.up(*pick, *end) == bound.up(next[0], next[1]);
            assert!(is_seam || !(turned.contains(&next) && is_same), "{pick} {end}: side by side");
        }
        turned
    }

    #[test]
    fn drafts_without_long_floats_stay_as_they_are() {
        for (n, step) in [(5, 2), (8, 3), (16, 7)] {
            let satin = Draft::satin(n, step).unwrap();
            let raw = Crossings::from_fn([2 * n, 3 * n], 1, |pick, end| satin.up(pick % n, end % n));
            assert_eq!(check(&raw, n - 1), Vec::<[usize; 2]>::new());
            // One yarn less, and each float is bound.
            assert!(!check(&raw, n - 2).is_empty());
        }
    }

    /// An area of floats alone, bound within n - 1, becomes a satin: as many points as it needs, none beside
    /// or at the corner of another one.
    #[test]
    fn wide_floats_are_bound_as_a_satin() {
        for (limit, n) in [(7, 8), (8, 8), (9, 10), (11, 12), (15, 16)] {
            for value in [true, false] {
                for wefts in 1..=3 {
                    let raw = Crossings::from_fn([2 * n * wefts, 3 * n], wefts, |_, _| value);
                    let turned = check(&raw, limit);
                    assert_eq!(turned.len(), raw.up.len() / n, "{limit} {value} {wefts}");
                    let mut bound = raw.clone();
                    bind(&mut bound, limit);
                    for [pick, end] in turned {
                        for (by_pick, by_end) in [(wefts, 0), (0, 1), (wefts, 1), (wefts, raw.ends - 1)] {
                            let near = bound.up((pick + by_pick) % raw.picks, (end + by_end) % raw.ends);
                            assert_eq!(near, value, "{limit} {value} {wefts}: {pick} {end}");
                        }
                    }
                }
            }
        }
    }

    /// One float in a plain weave, of one end over an odd number of picks, is cut by binding points at equal
    /// distances.
    #[test]
    fn a_single_float_is_bound_in_its_middle() {
        let raw = Crossings::from_fn([32, 32], 1, |pick, end| match (pick, end) {
            (11..=21, 7) => true,
            _ => (pick + end) % 2 == 0,
        });
        assert_eq!(check(&raw, 11), Vec::<[usize; 2]>::new());
        assert_eq!(check(&raw, 10).len(), 1);
        let [[pick, end]] = check(&raw, 6)[..] else { panic!("one binding point is enough") };
        assert_eq!([pick, end], [16, 7]);
    }

    /// The place in the middle is left for one without binding points beside it.
    #[test]
    fn binding_points_keep_apart() {
        let raw = Crossings::from_fn([32, 32], 1, |pick, end| match (pick, end) {
            (11..=21, 7) => true,
            // Up to pick 17 the wefts beside the float lie where it could be bound.
            (..18, _) => (pick + end) % 2 == 1,
            _ => (pick + end) % 2 == 0,
        });
        let [[pick, end]] = check(&raw, 10)[..] else { panic!("one binding point is enough") };
        assert!([18, 20].contains(&pick) && end == 7, "{pick} {end}");
    }

    /// A float is bound by a pick that does not float too far then.
    #[test]
    fn binding_points_make_no_long_floats() {
        let raw = Crossings::from_fn([32, 32], 1, |pick, end| match (pick, end) {
            (13..=25, 7) => true,
            (13 | 25, 6 | 8) => true,
            (14..=24, 6 | 8) => false,
            // Of the picks that could bind it, all but one float on both sides of the end.
            (14 | 15 | 17..=24, 0..=14) => false,
            _ => (pick + end) % 2 == 0,
        });
        assert_eq!(check(&raw, 12), [[16, 7]]);
    }

    /// The ground weft binds an end, so that no other color shows.
    #[test]
    fn the_ground_weft_binds_the_warp() {
        let raw = Crossings::from_fn([64, 32], 2, |pick, end| match (pick, end) {
            (22..=47, 7) => true,
            _ => (pick / 2 + end) % 2 == 0,
        });
        let [[pick, end]] = check(&raw, 11)[..] else { panic!("one binding point is enough") };
        assert!(pick % 2 == 0 && end == 7, "{pick} {end}");
    }

    proptest! {
        #[test]
        fn any_draft_is_bound(
            rows in 2usize..14,
            ends in 2usize..14,
            wefts in 1usize..5,
            limit in MIN_LIMIT..9,
            share in 0u64..=8,
            seed: u64,
        ) {
            let mut state = seed;
            let raw = Crossings::from_fn([rows * wefts, ends], wefts, |_, _| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) % 8 < share
            });
            check(&raw, limit);
        }
    }
}

//! Unevenness of yarns: maps a point of the uneven cloth to the point of the even cloth that appears there.
//!
//! A kind of yarn runs along a direction of the plane; across it, its yarns lie at whole numbers u. Yarn j is
//! displaced by o_j, and its width at the middle is g_j times that of the even yarn; both are functions of
//! the distance along the yarn. The even coordinate u lies at u + D(u), where D is the cubic Hermite
//! interpolant with D(j) = o_j and the slope g_j - 1 there. A wider yarn takes its space from the gaps beside
//! it. All coordinates appear as often as in the even cloth, since the mean of D' is 0. The values are hashes
//! of the yarn and of a segment of it, blended smoothly from segment to segment, so that segments repeat only
//! by chance.

use crate::cloth::{ClothCurves, Lattice, Unevenness, YarnLook};
use crate::math::floor_fraction;
use crate::math::hash::mix32;
use crate::{Result, io::invalid};

/// Number of fixed-point steps of [`Uneven::point`]; each reduces the error by the slope of the displacement,
/// mostly below a fifth.
const POINT_STEPS: usize = 12;
/// Inverse of the standard deviation of the sum of two uniform numbers in [-1/2, 1/2].
const PER_DEVIATION: f32 = 2.449_489_8;

/// Unevenness of the yarns of one kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct UnevenKind {
    /// Unit vector of the plane across the yarns.
    pub across: [f32; 2],
    /// Distance between neighboring yarns, and position of one of them along `across` [um].
    pub pitch_um: f32,
    pub start_um: f32,
    /// Length over which the values change [um].
    pub length_um: f32,
    /// Standard deviations of the width relative to its mean, and of the displacement relative to the pitch.
    pub width: f32,
    pub place: f32,
    /// Seed of the hashes.
    pub seed: u32,
}

/// Unevenness of all kinds of yarns of a cloth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Uneven {
    pub(crate) kinds: Vec<UnevenKind>,
}

impl Uneven {
    /// Whether all yarns are even.
    pub fn is_even(&self) -> bool {
        self.kinds.is_empty()
    }

    /// Derives the unevenness from the looks of the yarns. The width is the square root of a yarn's area, so
    /// it varies half as much as the count.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for uneven yarns of a kind that run along several directions.
    pub fn new(looks: &[YarnLook], curves: &ClothCurves, lattice: &Lattice) -> Result<Uneven> {
        let mut kinds = Vec::new();
        for (kind, look) in looks.iter().enumerate() {
            let Some(Unevenness { count_cv: count, spacing_cv: spacing, length_mm }) = look.unevenness else {
                continue;
            };
            let name = &look.name;
            let of_kind: Vec<usize> =
                (0..curves.yarns.len()).filter(|i| curves.yarns[*i].kind as usize == kind).collect();
            let Some(first) = of_kind.first().filter(|_| count > 0.0 || spacing > 0.0) else { continue };
            let vector = |i: usize| lattice.vector(curves.yarns[i].period);
            let period = vector(*first);
            let length = period[0].hypot(period[1]);
            let across = [period[1] / length, -period[0] / length];
            let off = |i: &usize| (vector(*i)[0] * across[0] + vector(*i)[1] * across[1]).abs();
            if of_kind.iter().any(|i| off(i) > 1e-6 * length) {
                let (key, value) = if count > 0.0 { ("count_cv", count) } else { ("spacing_cv", spacing) };
                let hint = "its yarns run along several directions; leave count_cv and spacing_cv out";
                return Err(invalid("cloth", &format!("{name}.{key}"), value, hint));
            }
            // The cell contains one period of each of its yarns, or an equal length of a shorter one.
            let all: f64 = of_kind.iter().map(|i| vector(*i)[0].hypot(vector(*i)[1])).sum();
            let of_first = curves.curves.iter().filter(|c| c.yarn as usize == *first);
            let at: Vec<f64> =
                of_first.flat_map(|c| &c.control_um).map(|p| p[0] * across[0] + p[1] * across[1]).collect();
            let start = at.iter().sum::<f64>() / at.len().max(1) as f64;
            kinds.push(UnevenKind {
                across: across.map(|v| v as f32),
                pitch_um: (lattice.area_um2() / all) as f32,
                start_um: start as f32,
                length_um: (1e3 * length_mm) as f32,
                width: (0.5 * count) as f32,
                place: spacing as f32,
                seed: mix32(kind as u32 + 1),
            });
        }
        Ok(Uneven { kinds })
    }

    /// The point [um] at which a point of the even cloth appears: the inverse of [`Uneven::place`]. Where
    /// yarns displace each other so far that a point appears twice or not at all, the result is a point near
    /// it.
    pub fn point(&self, place_um: [f32; 2]) -> [f32; 2] {
        let mut at = place_um;
        for _ in 0..POINT_STEPS {
            let shows = self.place(at);
            (0..2).for_each(|k| at[k] += place_um[k] - shows[k]);
        }
        at
    }

    /// The point of the even cloth [um] that appears at a point of the uneven cloth.
    #[inline(always)]
    pub fn place(&self, at_um: [f32; 2]) -> [f32; 2] {
        let mut to = at_um;
        for kind in &self.kinds {
            let by = kind.shift_um(at_um);
            (0..2).for_each(|k| to[k] -= by * kind.across[k]);
        }
        to
    }
}

impl UnevenKind {
    /// All values except the seed.
    pub fn numbers(&self) -> [f32; 7] {
        let [a, b] = self.across;
        [a, b, self.pitch_um, self.start_um, self.length_um, self.width, self.place]
    }

    /// Displacement across the yarns of the cloth that appears at a point [um].
    #[inline(always)]
    fn shift_um(&self, [x, y]: [f32; 2]) -> f32 {
        let [a, b] = self.across;
        let (u, along) = ((x * a + y * b - self.start_um) / self.pitch_um, (y * a - x * b) / self.length_um);
        // Solves u = at - D(u) in two fixed-point steps: D and its slope are small.
        self.pitch_um * self.off(u - self.off(u, along), along)
    }

    /// D at a coordinate across the yarns, in pitches.
    #[inline(always)]
    fn off(&self, u: f32, along: f32) -> f32 {
        let (yarn, t) = floor_fraction(u);
        let [(from, rise), (to, fall)] = [yarn, yarn.wrapping_add(1)].map(|yarn| self.values(yarn, along));
        let (t2, s) = (t * t, 1.0 - t);
        let mean = from + t2 * (3.0 - 2.0 * t) * (to - from);
        mean + t * s * (s * rise - t * fall)
    }

    /// D and its slope at a yarn, `along` lengths from the origin.
    #[inline(always)]
    fn values(&self, yarn: i32, along: f32) -> (f32, f32) {
        let row = mix32(self.seed ^ yarn as u32);
        let (stretch, t) = floor_fraction(along + row as f32 * (1.0 / 4_294_967_296.0));
        let [a, b] = [stretch, stretch.wrapping_add(1)].map(|stretch| deviates(mix32(row ^ stretch as u32)));
        // The weights' squares sum to 1, so that the variance is uniform along the yarn.
        let s = t * t * (3.0 - 2.0 * t);
        let per = 1.0 / (s * s + (1.0 - s) * (1.0 - s)).sqrt();
        let [place, width] = [0, 1].map(|k| per * ((1.0 - s) * a[k] + s * b[k]));
        (self.place * place, self.width * width)
    }
}

/// Two numbers of mean 0 and variance 1 from a hash, within 2.45.
#[inline(always)]
fn deviates(hash: u32) -> [f32; 2] {
    let part = |shift: u32| ((hash >> shift) & 0xff) as f32 * (1.0 / 255.0);
    [0, 16].map(|shift| PER_DEVIATION * (part(shift) + part(shift + 8) - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: UnevenKind = UnevenKind {
        across: [0.6, -0.8],
        pitch_um: 250.0,
        start_um: 40.0,
        length_um: 8000.0,
        width: 0.08,
        place: 0.04,
        seed: 77,
    };

    /// The even coordinate that appears at `u` pitches across the yarns and `v` lengths along them.
    fn shows(kind: UnevenKind, u: f64, v: f64) -> f64 {
        let [a, b] = kind.across.map(f64::from);
        let (x, y) = (u * f64::from(kind.pitch_um) + f64::from(kind.start_um), v * f64::from(kind.length_um));
        let at = [x * a - y * b, x * b + y * a].map(|p| p as f32);
        let [x, y] = Uneven { kinds: vec![kind] }.place(at).map(f64::from);
        (x * a + y * b - f64::from(kind.start_um)) / f64::from(kind.pitch_um)
    }

    /// The position at which the even coordinate `u` appears, by bisection.
    fn is_at(u: f64, v: f64) -> f64 {
        let (mut low, mut high) = (u - 0.5, u + 0.5);
        for _ in 0..40 {
            let mid = 0.5 * (low + high);
            *(if shows(KIND, mid, v) < u { &mut low } else { &mut high }) = mid;
        }
        0.5 * (low + high)
    }

    fn moments(of: &[f64]) -> (f64, f64) {
        let mean = of.iter().sum::<f64>() / of.len() as f64;
        (mean, (of.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / of.len() as f64).sqrt())
    }

    /// On the uneven cloth, displacements and widths of yarns vary as the spec says: smoothly along a yarn
    /// over the length, independently from yarn to yarn, and without repetition.
    #[test]
    fn yarns_vary_as_the_spec_has_them() {
        let width = |yarn: f64, v: f64| (is_at(yarn + 0.01, v) - is_at(yarn - 0.01, v)) / 0.02;
        let all: Vec<[f64; 2]> = (0..3000)
            .map(|i| (f64::from(i / 3 - 500), 40.0 * f64::from(i % 3) + 0.013 * f64::from(i)))
            .map(|(yarn, v)| [is_at(yarn, v) - yarn, width(yarn, v)])
            .collect();
        let (off, place) = moments(&all.iter().map(|a| a[0]).collect::<Vec<_>>());
        let (mean, deviation) = moments(&all.iter().map(|a| a[1]).collect::<Vec<_>>());
        println!("places {off:.4} {place:.4}, widths {mean:.4} {deviation:.4}");
        assert!(off.abs() < 0.003 && (place / f64::from(KIND.place) - 1.0).abs() < 0.06, "{off} {place}");
        assert!(
            (mean - 1.0).abs() < 0.01 && (deviation / f64::from(KIND.width) - 1.0).abs() < 0.1,
            "{mean} {deviation}"
        );
        let alike = |shift: &dyn Fn(f64, f64) -> (f64, f64)| {
            let pairs = (0..3000).map(|i| (f64::from(i % 250), 0.37 * f64::from(i)));
            let of = |(yarn, v): (f64, f64)| width(yarn, v) - 1.0;
            let products: f64 = pairs.map(|(yarn, v)| of((yarn, v)) * of(shift(yarn, v))).sum();
            products / 3000.0 / (deviation * deviation)
        };
        assert!(alike(&|yarn, v| (yarn, v + 0.1)) > 0.9);
        for apart in [
            alike(&|yarn, v| (yarn, v + 2.0)),
            alike(&|yarn, v| (yarn, v + 64.0)),
            alike(&|yarn, v| (yarn + 1.0, v)),
            alike(&|yarn, v| (yarn + 64.0, v)),
        ] {
            assert!(apart.abs() < 0.08, "{apart}");
        }
    }

    /// Each part of the pattern covers as much area of the uneven cloth as of the even one, and almost no
    /// part appears twice: for a spun yarn, and for the largest unevenness that a spec allows.
    #[test]
    fn places_turn_up_as_often_as_in_an_even_cloth() {
        const PARTS: usize = 10;
        for (kind, limit, twice) in [(KIND, 0.02, 0.0), (UnevenKind { width: 0.25, place: 0.15, ..KIND }, 0.05, 0.02)] {
            let (mut counts, mut total, mut back, mut largest) = ([0u32; PARTS], 0, 0u32, 0.0f64);
            for line in 0..800 {
                let v = 1.7 * f64::from(line);
                let mut before = f64::NEG_INFINITY;
                for i in 0..2000 {
                    let u = shows(kind, 0.01 * f64::from(i), v);
                    back += u32::from(u < before - 1e-3);
                    largest = largest.max((u - 0.01 * f64::from(i)).abs());
                    before = u;
                    counts[((u.rem_euclid(1.0) * PARTS as f64) as usize).min(PARTS - 1)] += 1;
                    total += 1;
                }
            }
            let shares = counts.map(|n| f64::from(n) * PARTS as f64 / f64::from(total));
            let back = f64::from(back) / f64::from(total);
            println!("shares {shares:.3?}, backwards {back:.5}, largest shift {largest:.3}");
            assert!(shares.iter().all(|share| (share - 1.0).abs() < limit), "{shares:?}");
            assert!(back <= twice && largest < 0.75, "{back} {largest}");
        }
    }

    /// Prints the time of one evaluation: run with `-- --nocapture`.
    #[test]
    #[ignore = "a figure"]
    fn time_of_a_place() {
        let uneven = Uneven { kinds: vec![KIND, UnevenKind { across: [0.8, 0.6], seed: 5, ..KIND }] };
        let start = std::time::Instant::now();
        let sum: f32 = (0..1_000_000u32).map(|i| uneven.place([i as f32, 0.37 * i as f32])[0]).sum();
        println!("{:.1} ns ({sum})", start.elapsed().as_secs_f64() * 1e3);
    }

    /// A point of the even cloth appears at its computed point.
    #[test]
    fn points_of_places_are_found() {
        let uneven = Uneven { kinds: vec![KIND, UnevenKind { across: [0.8, 0.6], seed: 5, ..KIND }] };
        for i in 0..2000u32 {
            let place = [37.3 * i as f32, 11.9 * i as f32 - 5000.0];
            let shows = uneven.place(uneven.point(place));
            assert!((shows[0] - place[0]).hypot(shows[1] - place[1]) < 0.5, "{place:?} {shows:?}");
        }
    }

    /// No finite input panics.
    #[test]
    fn any_place_has_one() {
        let uneven = Uneven { kinds: vec![KIND, UnevenKind { across: [0.0, 1.0], ..KIND }] };
        for x in [0.0, -1e7, 1e7, 3.3e38, -3.3e38] {
            let _ = uneven.place([x, 2.0]);
            assert!(x.abs() > 1e8 || uneven.place([x, 2.0]).iter().all(|v| v.is_finite()));
        }
    }
}

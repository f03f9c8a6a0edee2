//! Length of paths: Russian roulette from a fixed depth, a cut after the largest number of scatterings, and
//! an estimate of the light that cuts omit.
//!
//! The survival probability is the path's throughput if that is below 1, so that a path among non-absorbing
//! fibers ends only where it escapes. The cut guards against paths that never escape, or limits the orders of
//! scattering. Some cut paths are followed further without adding to the picture: they estimate the light of
//! a cut path relative to its throughput.

use crate::WAVELENGTHS;
use crate::numbers::PathNumbers;
use crate::spectrum::{Light4, xyz};
use rand::RngExt;

/// Default largest number of scatterings of a path. The light within an infinitely deep layer of clear fibers
/// falls as 1 / sqrt(n) after n scatterings, which is 0.4 % here.
pub const MAX_SCATTERINGS: u32 = 1 << 16;
/// Scatterings after which Russian roulette begins.
const ROULETTE: u32 = 4;
/// Probability that a cut path is followed. For clear fur cut after 8 scatterings, which omits 66 % of its
/// light, this takes 2 % more time.
const FOLLOWED: f32 = 1.0 / 32.0;

/// Throughput of a followed path relative to that at its cut, below which it ends.
const NEGLIGIBLE: f32 = 1e-3;

/// A cut path.
struct Cut {
    /// Light along the path before the cut.
    light: Light4,
    /// Its throughput.
    carried: Light4,
    followed: bool,
}

/// Course of a path: its scatterings so far.
pub(crate) struct Course {
    depth: u32,
    most: u32,
    cut: Option<Cut>,
}

impl Course {
    /// Course of a path of at most this many scatterings.
    pub fn new(most: u32) -> Course {
        Course { depth: 0, most, cut: None }
    }

    /// Scatterings so far.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// Whether the path scatters once more; `light` is the light along it so far.
    pub fn goes_on(&mut self, throughput: &Light4, light: &Light4, rng: &mut PathNumbers) -> bool {
        if self.depth < self.most {
            return true;
        }
        if self.cut.is_some() {
            return false;
        }
        let followed = rng.random::<f32>() < FOLLOWED;
        self.cut = Some(Cut { light: *light, carried: *throughput, followed });
        if followed {
            self.most = self.most.saturating_add(MAX_SCATTERINGS);
        }
        followed
    }

    /// Counts a scattering; returns whether the path survives Russian roulette, with its throughput scaled. A
    /// path followed beyond a cut has no roulette, for less noise from few paths; it ends when its throughput
    /// is negligible.
    pub fn survives(&mut self, throughput: &mut Light4, rng: &mut PathNumbers) -> bool {
        let most = |light: &Light4| light.iter().copied().fold(0.0f32, f32::max);
        if let Some(cut) = &self.cut {
            if most(throughput) < NEGLIGIBLE * most(&cut.carried) {
                return false;
            }
        } else if self.depth >= ROULETTE {
            let keep = most(throughput).min(1.0);
            if rng.random::<f32>() >= keep {
                return false;
            }
            throughput.iter_mut().for_each(|t| *t /= keep);
        }
        self.depth += 1;
        true
    }

    /// The picture's share of the light along the path, and the sums for the light that cuts omit. `is_hit`:
    /// whether the path hit something.
    pub fn end(self, light: Light4, lambda: Light4, is_hit: bool) -> (Light4, CutSums) {
        let y = |l: Light4| f64::from(xyz(lambda, l)[1]);
        let seen = |l: Light4| CutSums { seen: y(l), hits: 1.0, ..CutSums::default() };
        match self.cut {
            _ if !is_hit => (light, CutSums::default()),
            None => (light, seen(light)),
            Some(Cut { light: before, carried, followed }) => {
                let carried = y(carried);
                let mut sums = CutSums { carried, ..seen(before) };
                if followed {
                    sums.followed = carried;
                    sums.brought = y(std::array::from_fn::<f32, WAVELENGTHS, _>(|k| light[k] - before[k]));
                }
                (before, sums)
            }
        }
    }
}

/// Sums over paths that hit something, of Y of their light or of their throughput.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CutSums {
    /// Light in the picture.
    pub seen: f64,
    /// Number of paths.
    pub hits: f64,
    /// Throughput of paths at their cuts.
    pub carried: f64,
    /// Throughput of the followed ones of them.
    pub followed: f64,
    /// Light of the followed paths.
    pub brought: f64,
}

impl CutSums {
    pub fn add(&mut self, other: &CutSums) {
        self.seen += other.seen;
        self.hits += other.hits;
        self.carried += other.carried;
        self.followed += other.followed;
        self.brought += other.brought;
    }

    /// Omitted light over all light of visible objects, 0 to 1. The estimate counts one more followed path,
    /// with the light of the mean path from the camera, for cuts so rare that none was followed.
    pub fn share(&self) -> f64 {
        if self.carried <= 0.0 || self.hits <= 0.0 {
            return 0.0;
        }
        // q = (brought + mean) / (followed + 1), mean = (seen + carried q) / hits.
        let rest = (1.0 - self.carried / self.hits).max(1e-6);
        let left_out = self.carried * (self.brought + self.seen / self.hits) / (self.followed + rest);
        left_out / (self.seen + left_out).max(f64::MIN_POSITIVE)
    }

    /// Text for a file, with all digits.
    pub fn to_text(self) -> String {
        let CutSums { seen, hits, carried, followed, brought } = self;
        format!("{seen} {hits} {carried} {followed} {brought}")
    }

    /// Sums from [`CutSums::to_text`].
    pub fn of_text(text: &str) -> Option<CutSums> {
        let values: Result<Vec<f64>, _> = text.split(' ').map(str::parse).collect();
        match values.ok()?[..] {
            [seen, hits, carried, followed, brought] => {
                let sums = CutSums { seen, hits, carried, followed, brought };
                [seen, hits, carried, followed, brought].iter().all(|v| v.is_finite()).then_some(sums)
            }
            _ => None,
        }
    }
}

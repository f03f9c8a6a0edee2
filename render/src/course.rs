//! How long a path goes on: thinned out by chance from a fixed depth, cut off after the most scatterings, and
//! what cuts leave out.
//!
//! The chance to go on is the path's throughput where that is below 1, so that a path among fibers that
//! absorb nothing ends only where it leaves them. The cut is a guard for paths that never
//! leave, or a wish for less light. Some of the paths that are cut are followed on beside the picture: they
//! tell what a cut path would have brought over what it carried.

use crate::WAVELENGTHS;
use crate::spectrum::{Light4, xyz};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Most scatterings of a path unless told otherwise. What an endlessly deep layer of clear fibers still holds
/// after n scatterings falls as 1 / sqrt(n), which is 0.4 % here.
pub const MAX_SCATTERINGS: u32 = 1 << 16;
/// Scatterings after which paths are thinned out by chance.
const ROULETTE: u32 = 4;
/// Chance of a path that is cut to be followed on. Clear fur that is cut after 8 scatterings, which leaves
/// out 66 % of its light, takes 2 % longer by it.
const FOLLOWED: f32 = 1.0 / 32.0;

/// Throughput of a path that is followed on, over that at its cut, below which it ends.
const NEGLIGIBLE: f32 = 1e-3;

/// A path that is cut.
struct Cut {
    /// What came along the path before.
    light: Light4,
    /// Its throughput.
    carried: Light4,
    followed: bool,
}

/// Scatterings of a path.
pub(crate) struct Course {
    depth: u32,
    most: u32,
    cut: Option<Cut>,
}

impl Course {
    /// Of a path of at most this many scatterings.
    pub fn new(most: u32) -> Course {
        Course { depth: 0, most, cut: None }
    }

    /// Scatterings so far.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// Whether the path is scattered once more; `light` is what came along it.
    pub fn goes_on(&mut self, throughput: &Light4, light: &Light4, rng: &mut Pcg64Mcg) -> bool {
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

    /// Counts a scattering; whether the path is among those that are kept, which stand for the others. What
    /// is followed beyond a cut is not thinned out, for less noise from few paths: it ends where nearly
    /// nothing is left.
    pub fn survives(&mut self, throughput: &mut Light4, rng: &mut Pcg64Mcg) -> bool {
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

    /// The light of the picture, of all that came along the path, and the sums of what cuts leave out.
    /// `is_hit`: whether the path met something.
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

/// Sums over paths that met something, of Y of their light or of their throughput.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CutSums {
    /// Light in the picture.
    pub seen: f64,
    /// Number of paths.
    pub hits: f64,
    /// What paths carried where they were cut.
    pub carried: f64,
    /// The part of it that was followed on.
    pub followed: f64,
    /// Light that the followed ones brought.
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

    /// Light that is left out over all light of what is seen, 0 to 1. Beside the paths that were followed,
    /// one is taken to bring what the mean path from the camera does with nothing left out, for
    /// cuts so rare that none was followed.
    pub fn share(&self) -> f64 {
        if self.carried <= 0.0 || self.hits <= 0.0 {
            return 0.0;
        }
        // q = (brought + mean) / (followed + 1), mean = (seen + carried q) / hits.
        let rest = (1.0 - self.carried / self.hits).max(1e-6);
        let left_out = self.carried * (self.brought + self.seen / self.hits) / (self.followed + rest);
        left_out / (self.seen + left_out).max(f64::MIN_POSITIVE)
    }

    /// For a file; every digit is kept.
    pub fn to_text(self) -> String {
        let CutSums { seen, hits, carried, followed, brought } = self;
        format!("{seen} {hits} {carried} {followed} {brought}")
    }

    /// From [`CutSums::to_text`].
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

//! Length of paths: Russian roulette from a fixed depth, a cut at the largest number of scatterings, and an
//! estimate of the light that cuts omit.
//!
//! The survival probability is the path's throughput if that is below 1, so a path among non-absorbing fibers
//! ends only where it escapes. The cut limits the orders of scattering and bounds paths that never escape. A
//! random share of the cut paths is continued without adding to the picture; these paths estimate the light
//! of a cut path relative to its throughput.

use crate::WAVELENGTHS;
use crate::numbers::PathNumbers;
use crate::spectrum::{Light4, xyz};
use rand::RngExt;

/// Default largest number of scatterings of a path. In an infinitely deep layer of non-absorbing fibers the
/// remaining light falls as 1 / sqrt(n) with the number n of scatterings, which is 0.4 % here.
pub const MAX_SCATTERINGS: u32 = 1 << 16;
/// Number of scatterings after which Russian roulette begins.
const ROULETTE: u32 = 4;
/// Probability that a cut path is continued. It costs 2 % more time for non-absorbing fur that is cut after 8
/// scatterings, which omits 66 % of the light.
const FOLLOWED: f32 = 1.0 / 32.0;

/// Throughput relative to that at the cut, below which a continued path ends.
const NEGLIGIBLE: f32 = 1e-3;

/// State of a path at its cut.
struct Cut {
    /// Light along the path up to the cut.
    light: Light4,
    /// Throughput at the cut.
    carried: Light4,
    followed: bool,
}

/// Number of scatterings of a path, its limit, and its cut.
pub(crate) struct RouletteState {
    depth: u32,
    max: u32,
    cut: Option<Cut>,
}

impl RouletteState {
    /// State of a path that may scatter `max` times.
    pub fn new(max: u32) -> RouletteState {
        RouletteState { depth: 0, max, cut: None }
    }

    /// Number of scatterings so far.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// State of another branch of a path that is not cut.
    pub fn branch(&self) -> RouletteState {
        RouletteState { depth: self.depth, max: self.max, cut: None }
    }

    /// Whether the path is beyond its cut.
    pub fn is_cut(&self) -> bool {
        self.cut.is_some()
    }

    /// Number of scatterings after the present one that add to the picture.
    pub fn remaining(&self) -> u32 {
        if self.cut.is_some() { 0 } else { (self.max - 1).saturating_sub(self.depth) }
    }

    /// Whether the path scatters once more; `light` is the light that it has gathered so far.
    pub fn goes_on(&mut self, throughput: &Light4, light: &Light4, rng: &mut PathNumbers) -> bool {
        if self.depth < self.max {
            return true;
        }
        if self.cut.is_some() {
            return false;
        }
        let followed = rng.random::<f32>() < FOLLOWED;
        self.cut = Some(Cut { light: *light, carried: *throughput, followed });
        if followed {
            self.max = self.max.saturating_add(MAX_SCATTERINGS);
        }
        followed
    }

    /// Counts a scattering and plays Russian roulette: returns whether the path survives, with its throughput
    /// divided by the survival probability. A path that continues beyond its cut plays no roulette, because
    /// few such paths would make the estimate noisy; it ends when its throughput is negligible.
    pub fn survives(&mut self, throughput: &mut Light4, rng: &mut PathNumbers) -> bool {
        let max = |light: &Light4| light.iter().copied().fold(0.0f32, f32::max);
        if let Some(cut) = &self.cut {
            if max(throughput) < NEGLIGIBLE * max(&cut.carried) {
                return false;
            }
        } else if self.depth >= ROULETTE {
            let keep = max(throughput).min(1.0);
            if rng.random::<f32>() >= keep {
                return false;
            }
            throughput.iter_mut().for_each(|t| *t /= keep);
        }
        self.depth += 1;
        true
    }

    /// The light that the path adds to the picture, and the sums that estimate the light omitted by cuts.
    /// `is_hit` is whether the path hit an object.
    pub fn end(self, light: Light4, lambda: Light4, is_hit: bool) -> (Light4, CutSums) {
        let y = |l: Light4| f64::from(xyz(lambda, l)[1]);
        let visible = |l: Light4| CutSums { visible: y(l), hits: 1.0, ..CutSums::default() };
        match self.cut {
            _ if !is_hit => (light, CutSums::default()),
            None => (light, visible(light)),
            Some(Cut { light: before, carried, followed }) => {
                let carried = y(carried);
                let mut sums = CutSums { carried, ..visible(before) };
                if followed {
                    sums.followed = carried;
                    sums.gathered = y(std::array::from_fn::<f32, WAVELENGTHS, _>(|k| light[k] - before[k]));
                }
                (before, sums)
            }
        }
    }
}

/// Sums over paths that hit an object: Y of their light or throughput.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CutSums {
    /// Y of the light in the picture.
    pub visible: f64,
    /// Number of paths.
    pub hits: f64,
    /// Y of the throughput of cut paths at their cuts.
    pub carried: f64,
    /// The part of that throughput that was continued.
    pub followed: f64,
    /// Y of the light that continued paths gathered beyond their cuts.
    pub gathered: f64,
}

impl CutSums {
    pub fn add(&mut self, other: &CutSums) {
        self.visible += other.visible;
        self.hits += other.hits;
        self.carried += other.carried;
        self.followed += other.followed;
        self.gathered += other.gathered;
    }

    /// Fraction of the light of visible objects that cuts omit, 0 to 1. The estimate adds one virtual
    /// continued path with the light of the mean camera path, which covers cuts so rare that no cut path was
    /// continued.
    pub fn share(&self) -> f64 {
        if self.carried <= 0.0 || self.hits <= 0.0 {
            return 0.0;
        }
        // q = (gathered + mean) / (followed + 1), mean = (visible + carried q) / hits.
        let rest = (1.0 - self.carried / self.hits).max(1e-6);
        let omitted = self.carried * (self.gathered + self.visible / self.hits) / (self.followed + rest);
        omitted / (self.visible + omitted).max(f64::MIN_POSITIVE)
    }

    /// Text of the sums for a file, with all digits.
    pub fn to_text(self) -> String {
        let CutSums { visible, hits, carried, followed, gathered } = self;
        format!("{visible} {hits} {carried} {followed} {gathered}")
    }

    /// Parses the text of [`CutSums::to_text`].
    pub fn from_text(text: &str) -> Option<CutSums> {
        let values: Result<Vec<f64>, _> = text.split(' ').map(str::parse).collect();
        match values.ok()?[..] {
            [visible, hits, carried, followed, gathered] => {
                let sums = CutSums { visible, hits, carried, followed, gathered };
                [visible, hits, carried, followed, gathered].iter().all(|v| v.is_finite()).then_some(sums)
            }
            _ => None,
        }
    }
}

//! Woven fabrics as surfaces (Yu 2025, 3.2, 3.3 and 7.1): for a point of the fabric and a direction, which
//! ply of which yarn is met, at which theta_i and h, or which gap.
//!
//! The fabric lies in the plane of x and y [um], z is its normal on the face. Weft yarns (picks) run along x,
//! warp yarns (ends) along y. End j lies at `x = (j + 1/2) spacing` of the warp, pick i at
//! `y = (i + 1/2) spacing` of the weft; both go on without end, the draft repeats.
//! Only the draft is stored, one bit per crossing: everything else is computed on demand, without allocation.
//! A line hits the first yarn along it; light that leaves a ply hits other yarns (`between.rs`).

pub(crate) mod at;
pub(crate) mod between;
mod bsdf;
mod center_line;
pub(crate) mod color_of;
mod draft;
pub(crate) mod dye;
pub(crate) mod far;
mod far_query;
pub(crate) mod flight;
mod follow;
pub(crate) mod hit;
mod layers;
mod load;
mod names;
pub(crate) mod paths;
mod profile;
mod query;
mod regression;
mod rules;
pub(crate) mod shade;
pub(crate) mod shadow;
mod spec;
pub(crate) mod splines;
pub(crate) mod tensors;
mod uv;
mod walk;
mod wif;
mod yarn;

pub use at::FabricBsdf;
pub use bsdf::FabricModel;
pub use center_line::{CenterPoint, Overlap};
pub use color_of::ColorOf;
pub use draft::{Draft, MAX_THREADS};
pub use dye::{Channels, ColorReach};
pub use hit::{Gap, Hit, PlyHit, YarnPlace};
pub use layers::Layer;
pub use load::{LoadedFabric, USUAL_LEAN_DEG};
pub use query::{FabricOptions, FabricQuery, GapLight, Slits};
#[doc(hidden)]
pub use rules::FABRIC_RULES;
pub(crate) use rules::{WEAVES, check_weave};
pub use spec::{FabricSpec, WeaveSpec, YarnColor, YarnOfFabric};
pub use tensors::{Tensor, Values};
pub use uv::UvMap;
pub use wif::{Wif, WifNote, WifNoteKind, WifSpacing};
pub use yarn::YarnShape;

use crate::Result;
use yarn::Yarn;

/// The two families of yarns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum YarnSet {
    /// Ends, along y.
    Warp,
    /// Picks, along x.
    Weft,
}

impl YarnSet {
    /// Warp, then weft: the order of every pair by family.
    pub const EACH: [YarnSet; 2] = [YarnSet::Warp, YarnSet::Weft];

    /// The other family.
    pub fn other(self) -> YarnSet {
        match self {
            YarnSet::Warp => YarnSet::Weft,
            YarnSet::Weft => YarnSet::Warp,
        }
    }

    /// Name as in a fabric spec.
    pub fn name(self) -> &'static str {
        match self {
            YarnSet::Warp => "warp",
            YarnSet::Weft => "weft",
        }
    }
}

/// A fabric's geometry: draft, yarns and their colors. [`Fabric::at`] and [`Fabric::yarn_at`] ask it.
#[derive(Clone, Debug)]
pub struct Fabric {
    draft: Draft,
    shapes: [YarnShape; 2],
    yarns: [Yarn; 2],
    /// Of one repeat, or one for all.
    colors: [Vec<YarnColor>; 2],
}

impl Fabric {
    /// A fabric of a draft and the shapes of warp and weft; undyed.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for a draft that leaves a yarn unbound, shapes out of range and a spacing
    /// narrower than the yarn.
    pub fn new(draft: Draft, shapes: [YarnShape; 2]) -> Result<Fabric> {
        Fabric::named(draft, shapes, [vec![YarnColor::Undyed], vec![YarnColor::Undyed]], "fabric")
    }

    fn named(draft: Draft, shapes: [YarnShape; 2], colors: [Vec<YarnColor>; 2], file: &str) -> Result<Fabric> {
        if let Some((family, thread, up)) = draft.unbound() {
            let side = if up { "above" } else { "below" };
            let value = format!("{} {} lies {side} all others", family.name(), thread + 1);
            return Err(crate::spec::rules::invalid(file, "draft", value, "bind every yarn"));
        }
        rules::check_shapes(file, &shapes)?;
        let yarns = [Yarn::new(&shapes[0], &shapes[1]), Yarn::new(&shapes[1], &shapes[0])];
        Ok(Fabric { draft, shapes, yarns, colors })
    }

    /// Says of which families' yarns the plies scatter one by one.
    fn set_one_by_one(&mut self, one_by_one: [bool; 2]) {
        self.yarns.iter_mut().zip(one_by_one).for_each(|(yarn, is)| yarn.one_by_one = is);
    }

    /// The draft.
    pub fn draft(&self) -> &Draft {
        &self.draft
    }

    /// The yarns of a family.
    pub fn shape(&self, family: YarnSet) -> &YarnShape {
        &self.shapes[family as usize]
    }

    /// Color of a yarn; yarns of a WIF repeat with the draft.
    pub fn color(&self, family: YarnSet, yarn: i32) -> YarnColor {
        let colors = &self.colors[family as usize];
        let at = i64::from(yarn).rem_euclid(colors.len().max(1) as i64);
        colors.get(at as usize).copied().unwrap_or(YarnColor::Undyed)
    }

    /// Size of one repeat along x and y [um].
    pub fn repeat_um(&self) -> [f64; 2] {
        [self.draft.ends() as f64 * self.shapes[0].spacing_um, self.draft.picks() as f64 * self.shapes[1].spacing_um]
    }

    /// Greatest distance of any fiber from the fabric's middle plane [um].
    pub fn half_thickness_um(&self) -> f32 {
        self.yarns.iter().map(|y| y.profile.amplitude + y.half_width).fold(0.0, f32::max)
    }

    /// Greatest lean of a family's yarns between crossings over which they change sides [degrees].
    pub fn lean_deg(&self, family: YarnSet) -> f64 {
        f64::from(self.yarns[family as usize].profile.steepest()).atan().to_degrees()
    }

    /// Crimp with which a family's yarns lean by [`USUAL_LEAN_DEG`], 0.5 at most.
    pub fn usual_crimp(&self, family: YarnSet) -> f64 {
        load::usual_crimp(&self.shapes[family as usize], &self.shapes[family.other() as usize])
    }

    /// Other colors, of one repeat of the yarns of warp and weft.
    fn set_colors(&mut self, colors: [Vec<YarnColor>; 2]) {
        self.colors = colors;
    }

    /// Bytes that draft and colors take.
    pub fn memory_bytes(&self) -> usize {
        self.draft.memory_bytes() + self.colors.iter().map(|c| c.len() * size_of::<YarnColor>()).sum::<usize>()
    }
}

//! The language of cloths: a weaver's spec (TOML) of yarns, weaves and knits, and what follows from it.
//!
//! A [`ClothSpec`] says which yarns cross how. Its yarns are written as on a label (`fiber = "cotton"`,
//! `count = "Ne 40"`, `twist = "Z 1000/m"`); [`YarnOfCloth`] has what follows: strands, radii, numbers of
//! fibers, and the spec of the ply model ([`YarnOfCloth::ply`]). [`Draft`] is the weave, from a name, rows,
//! a picture ([`PictureWeave`]) or a weavers' file ([`Wif`]); [`Chart`] has the stitches of a knit.
//! `plywave_sim::cloth` computes the curves of a spec.

mod cloth_spec;
mod knit;
mod picture;
mod ply_file;
mod rules;
mod thermal;
mod weave;
mod weave_spec;
mod words;
mod yarn;

pub use cloth_spec::{ClothSpec, ClothWeave, SourceCurves};
pub use knit::chart::{Chart, ChartError, MAX_CHART, MAX_HELD, Stitch};
pub use knit::picture::PictureChart;
pub use knit::spec::{KnitKind, KnitSpec};
pub use picture::area::{AreaWeave, WovenUnit};
pub use picture::pixels::{MAX_COLORS, Pixels};
pub use picture::spec::{ColorWeaves, MAX_WEFTS, PictureDraft, PictureWeave};
pub use ply_file::{load_yarn, load_yarn_file};
#[doc(hidden)]
pub use rules::CLOTH_RULES;
pub use thermal::Thermal;
pub use weave::draft::{Draft, MAX_THREADS, YarnSet};
pub use weave::floats::{Float, MAX_FLOAT_MM, check_floats, longest_floats};
pub use weave::layers::Layer;
pub use weave::named::NamedWeave;
pub use weave::wif::{Wif, WifNote, WifNoteKind, WifSpacing};
pub use weave_spec::WeaveSpec;
pub use yarn::count::Count;
pub use yarn::fibers::{Fiber, fiber_names};
pub use yarn::hairs::Hairs;
pub use yarn::ply::alike;
pub use yarn::stripe::Stripe;
pub use yarn::tartan::{COLOR_CODES, ColorCode, ThreadCount};
pub use yarn::twist::YarnTwist;
pub use yarn::{Derived, YarnOfCloth};

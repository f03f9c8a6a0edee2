//! Construction of a cloth: from a spec to the curves of its plies, and to the tables that shade them.
//!
//! A draft (`woven`) or a chart of stitches (`knit`) gives the starting curves. `relax` minimizes their
//! energy, and [`measure`] computes what a weaver would measure. Curves of other programs are read from and
//! written to files (`bcc`, `tg3`). [`precompute`](fn@precompute) finds shadows, inter-yarn scattering and
//! the mean over the cell.

mod bcc;
mod files;
mod flat;
mod hairs;
mod knit;
mod large;
mod make;
mod measure;
mod precompute;
mod relax;
mod tg3;
mod woven;

pub use files::{CurveFormat, write_curves};
pub use hairs::{Hair, HairKind, HairRoots};
pub use make::{MAX_FORCE, MadeCloth, make_cloth};
pub use measure::{ClothMeasures, ClothSolid, YarnMeasures, measure};
pub use precompute::{ClothStep, Effort, Progress, precompute};
pub use relax::{MAX_OVERLAP, Relaxed};

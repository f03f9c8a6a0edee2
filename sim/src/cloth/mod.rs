//! The making of a cloth: from a spec to the curves of its plies, and to all that shading needs.
//!
//! A draft (`woven`) or a grid of stitches (`knitted`) gives a start, `relax` the least energy, and
//! [`measure`] says what a weaver would measure. Curves of other programs come from and go to files (`bcc`,
//! `tg3`). `ready` finds shadows, the light between plies and the mean over the cell.

mod bcc;
mod files;
mod flat;
mod hairs;
mod knit;
mod knitted;
mod make;
mod measure;
mod minimize;
mod ready;
mod relax;
mod tg3;
mod woven;

pub use files::{CurveFormat, write_curves};
pub use hairs::{Hair, HairKind, HairRoots};
pub use make::{MAX_FORCE, MadeCloth, make_cloth};
pub use measure::{ClothMeasures, ClothSolid, YarnMeasures, measure};
pub use ready::{ClothStep, Effort, Told, make_ready};
pub use relax::{MAX_OVERLAP, Relaxed};

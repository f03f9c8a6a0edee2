//! The geometry of a cloth: from a spec to the curves of its plies.
//!
//! A draft (`woven`) or a grid of stitches (`knitted`) gives a start, `relax` the least energy, and
//! [`measure`] says what a weaver would measure. Curves of other programs come from and go to files (`bcc`,
//! `tg3`).

mod bcc;
mod files;
mod knit;
mod knitted;
mod make;
mod measure;
mod minimize;
mod relax;
mod tg3;
mod woven;

pub use files::{CurveFormat, write_curves};
pub use make::{MadeCloth, make_cloth};
pub use measure::{ClothMeasures, ClothSolid, YarnMeasures, measure};
pub use relax::{MAX_OVERLAP, Relaxed};

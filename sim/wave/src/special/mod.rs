//! Bessel and Hankel functions of integer order, of real and complex argument with Im z >= 0.
//!
//! Interfaces:
//! - [`cylinder01`], [`hankel01`], [`bessel01`]: orders 0 and 1 at any one argument;
//! - [`Ray`], [`real01`]: the same for many arguments along one ray `z = k r` of the complex plane, ten times
//!   faster;
//! - [`Sequence`]: all orders 0..=n with separate exponents, so that neither large orders nor lossy media
//!   overflow.
//!
//! Power series below |z| = 1, asymptotic series above 50; between them H comes from the crate
//! `complex-bessel` (Amos' algorithm 644) and J from its recurrence. Formulas by their number in DLMF
//! (dlmf.nist.gov).

mod expansions;
mod ray;
mod scaled;
mod sequence;
mod single;
#[cfg(test)]
mod tests;

use super::C64;

pub use expansions::Cylinder01;
pub use ray::{Ray, real01};
pub use scaled::{Scaled, power_of_two};
pub use sequence::Sequence;
pub use single::{bessel01, cylinder01, hankel01};

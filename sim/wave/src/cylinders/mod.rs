//! Circular cylinders, plain or layered: closed forms for one ([`mie`]) and several ([`multipole`]).

pub(crate) mod circle;
pub(crate) mod mie;
pub(crate) mod multipole;
#[cfg(test)]
mod multipole_tests;

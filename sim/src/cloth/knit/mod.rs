//! Knits: starting chains from stitches and yarn, before they are relaxed.
//!
//! `needles` knits a chart on a bed and says which stitch holds which loops; `curves` gives loops their form;
//! `layout` lays the yarn along them.

mod curves;
mod kinds;
mod layout;
mod needles;
mod tricot;

#[cfg(test)]
mod tests;

pub(super) use layout::knitted;

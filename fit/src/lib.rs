//! Fitter of plywave.

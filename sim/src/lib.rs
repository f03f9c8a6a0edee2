//! Simulator of plywave.

"""What comes from the Rust library (python/src/tensors.rs)."""

from plywave._plywave import ClothTables, fiber_file, host_constants, ply_file, ply_radius_um, ply_terms, speckle_factors

__all__ = ["CONSTANTS", "ClothTables", "fiber_file", "ply_file", "ply_radius_um", "ply_terms", "speckle_factors"]

#: Numbers of formulas by name, each typed once, in Rust (``src/host_constants.rs``).
CONSTANTS = host_constants()

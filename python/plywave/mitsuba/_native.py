"""What comes from the Rust library (python/src/tensors.rs)."""

from plywave._plywave import ClothTables, fiber_file, ply_file, ply_radius_um, ply_terms, speckle_factors

__all__ = ["ClothTables", "fiber_file", "ply_file", "ply_radius_um", "ply_terms", "speckle_factors"]

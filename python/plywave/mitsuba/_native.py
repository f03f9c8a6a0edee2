"""What comes from the Rust library (python/src/tensors.rs)."""

from plywave._plywave import ClothTables, FabricTables, fiber_file, ply_file, ply_radius_um, ply_terms, speckle_factors

__all__ = ["ClothTables", "FabricTables", "fiber_file", "ply_file", "ply_radius_um", "ply_terms", "speckle_factors"]

"""What comes from the Rust library (python/src/tensors.rs)."""

from plywave._plywave import FabricTables, ply_file, ply_radius_um, ply_terms

__all__ = ["FabricTables", "ply_file", "ply_radius_um", "ply_terms"]

"""What comes from the Rust library."""

try:
    from plywave._plywave import FabricTables, ply_file, ply_radius_um, ply_terms
except ImportError:  # development
    from mi_native import FabricTables, ply_file, ply_radius_um, ply_terms

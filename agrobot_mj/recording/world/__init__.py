"""3D content of a recording."""

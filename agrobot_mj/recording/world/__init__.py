"""3D content of a recording: ground, tractor, tracks, forces and labels."""

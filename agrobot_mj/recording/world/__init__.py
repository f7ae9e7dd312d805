"""What a recording shows in 3D."""

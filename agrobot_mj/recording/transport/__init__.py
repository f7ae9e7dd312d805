"""Files, viewers and images of recordings."""

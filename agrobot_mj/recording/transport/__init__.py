"""Files, viewers and pictures of recordings."""

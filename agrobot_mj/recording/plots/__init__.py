"""Time plots of a recording."""

"""Time plots of a recording: catalogue, axes and recorders."""

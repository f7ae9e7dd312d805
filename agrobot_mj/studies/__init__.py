"""Experiments about the model: comparisons, figures, the tyre rig, identification, validation."""

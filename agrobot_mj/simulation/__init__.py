"""The experiment: one tick, the loop around it, the log, and what a run leaves on disk."""

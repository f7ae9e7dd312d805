"""The experiment: one tick, the loop around it, the log, and the files that a run writes."""

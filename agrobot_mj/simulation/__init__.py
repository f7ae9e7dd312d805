"""Simulation of an experiment: one tick, the loop over ticks, the log, and the files of a run."""

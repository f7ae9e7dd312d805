"""Simulation of a scenario: one tick (control period), the loop over ticks, the log, and the files of a run."""

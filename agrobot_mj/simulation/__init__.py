"""Simulation of a scenario: the tick, the loop over ticks, the log, and the files of a run."""

"""Sweeps: runs of a scenario for all combinations of parameter values, samples, seeds and variants, in one table."""

from agrobot_mj.studies.sweep.runner import SweepOptions, SweepSummary, merge_results, sweep
from agrobot_mj.studies.sweep.schema import read_sweep

__all__ = ["SweepOptions", "SweepSummary", "merge_results", "read_sweep", "sweep"]

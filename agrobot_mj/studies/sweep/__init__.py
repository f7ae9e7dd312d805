"""Sweeps: runs of a scenario over axes, random samples, seeds and variants, with one table of results. Resumable."""

from agrobot_mj.studies.sweep.runner import SweepOptions, SweepSummary, merged, sweep
from agrobot_mj.studies.sweep.schema import read_sweep

__all__ = ["SweepOptions", "SweepSummary", "merged", "read_sweep", "sweep"]

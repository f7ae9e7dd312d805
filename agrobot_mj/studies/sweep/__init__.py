"""Sweeps: a scenario over axes, draws, seeds and variants, one table of results, resumed where it was interrupted."""

from agrobot_mj.studies.sweep.runner import SweepOptions, SweepSummary, merged, sweep
from agrobot_mj.studies.sweep.schema import read_sweep

__all__ = ["SweepOptions", "SweepSummary", "merged", "read_sweep", "sweep"]

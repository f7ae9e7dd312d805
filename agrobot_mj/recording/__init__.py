"""Recordings for the Rerun viewer: 3D scene, all signals, and a prepared layout. No other package imports rerun."""

from agrobot_mj.recording.comparison import write_comparison
from agrobot_mj.recording.recorder import Recording

__all__ = ["Recording", "write_comparison"]

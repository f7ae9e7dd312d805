"""Recordings for the Rerun viewer: 3D scene, signals and viewer layout. Only this package imports rerun."""

from agrobot_mj.recording.comparison import write_comparison
from agrobot_mj.recording.recorder import Recording

__all__ = ["Recording", "write_comparison"]

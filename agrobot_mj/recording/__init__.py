"""Recordings for the Rerun viewer: the scene in 3D, every signal, and a layout that opens well arranged.

This package is the only importer of rerun.
"""

from agrobot_mj.recording.comparison import write_comparison
from agrobot_mj.recording.recorder import Recording

__all__ = ["Recording", "write_comparison"]

"""Acquisition of the path after a start with a lateral offset: duration and overshoot."""

from typing import Any, ClassVar, Literal

import numpy as np

from agrobot_mj.core.signals import Column
from agrobot_mj.metrics.base import Metric, RunView

BAND_M = 0.05
"""Maximum distance from an acquired path [m]. Assumed value: twice the stated accuracy of RTK guidance."""
HELD_S = 5.0
"""Minimum time within BAND_M of an acquired path [s]. Assumed value: longer than half an oscillation."""
END_S = 2.0
"""Duration of the final part of the run, in which the maximum remaining offset is measured [s]."""


class Acquisition(Metric):
    """Acquisition of the path after a start with an offset (`path.start_offset_m`)."""

    kind: Literal["acquisition"] = "acquisition"
    columns: ClassVar = (
        Column(
            "acquisition.acquired_s",
            "s",
            f"first time after which the CG stays within {BAND_M:g} m for {HELD_S:g} s; or null",
        ),
        Column("acquisition.overshoot_m", "m", "maximum distance on the side of the path opposite to the start"),
        Column("acquisition.end_abs_max_m", "m", f"maximum distance from the path in the last {END_S:g} s"),
    )

    def evaluate(self, view: RunView) -> dict[str, Any]:
        """Return the acquisition metrics; empty for a path without start offset."""
        if not view.path.start_offset_m:
            return {}
        t, e = view.column("t"), view.cg_on_path.offset
        outside = t[~(np.abs(e) <= BAND_M)]
        begins = np.append(t[0], outside)
        held = np.diff(np.append(begins, t[-1])) >= HELD_S
        over = float(np.fmax.reduce(-np.sign(view.path.start_offset_m) * e, initial=0.0))
        at_end = float(np.fmax.reduce(np.abs(e[t > t[-1] - END_S]), initial=0.0))
        acquired = float(begins[np.argmax(held)]) if held.any() else None
        return {"acquisition": {"acquired_s": acquired, "overshoot_m": over, "end_abs_max_m": at_end}}

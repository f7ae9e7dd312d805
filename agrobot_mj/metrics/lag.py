"""How far a tractor is behind its reference at the end of a run, and how much slower it was at last.

Errors beside the path say nothing of a tractor that is late, since most laws follow the path and not its time.
"""

from math import hypot, isfinite
from typing import NamedTuple

import numpy as np

from agrobot_mj.metrics.base import LogLike

LAST_S = 10.0
"""Span at the end of a run over which speeds are averaged [s]."""
LATE_M = 1.0
"""Distance behind or ahead of the reference that is worth a word [m]. Assumed value: a second of work."""
SLOW, LOSING_M = 0.95, 0.5
"""Share of the reference's speed below which the tractor's is worth a word [-], and the distance behind it [m], since
every run starts from rest. Assumed value."""


class Lag(NamedTuple):
    """Where a tractor is beside its reference at the end of a run."""

    behind_m: float
    """Distance behind the reference, along its heading [m]."""
    speed_m_s: float
    """Mean speed of the tractor at last [m/s]."""
    reference_m_s: float
    """Mean speed of the reference at last [m/s]."""

    @property
    def text(self) -> str:
        """The lag in words; empty where there is none worth a word."""
        found = []
        if abs(self.behind_m) > LATE_M:
            found.append(f"{abs(self.behind_m):.1f} m {'behind' if self.behind_m > 0 else 'ahead of'} its reference")
        if self.behind_m > LOSING_M and self.speed_m_s < SLOW * self.reference_m_s:
            found.append(f"at {self.speed_m_s:.2f} of {self.reference_m_s:.2f} m/s")
        return ", ".join(found)


def lag_of(log: LogLike) -> Lag | None:
    """The lag at the end of a run; None where it is too short to have one, or its last row is not finite."""
    t = log.column("t")
    last = slice(int(np.searchsorted(t, t[-1] - LAST_S)) if len(t) else 0, None)
    if len(t[last]) < 2:
        return None
    span = float(t[-1] - t[last][0])
    reference = np.hypot(np.diff(log.column("x_ref")[last]), np.diff(log.column("y_ref")[last])).sum() / span
    found = Lag(
        float(log.column("e_longitudinal")[-1]), float(np.abs(log.column("speed")[last]).mean()), float(reference)
    )
    return found if isfinite(hypot(*found)) else None

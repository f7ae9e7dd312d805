"""Lag of the tractor behind its reference at the end of a run, as a distance and as mean speeds.

Cross-track errors do not include the lag, because most guidance laws follow the path independently of time.
"""

from math import hypot, isfinite
from typing import NamedTuple

import numpy as np

from agrobot_mj.metrics.base import LogLike

LAST_S = 10.0  # Duration of the final part of a run over which speeds are averaged [s]
LATE_M = 1.0
"""Distance behind or ahead of the reference above which the lag is reported [m]. Assumed value: 1 s at 1 m/s."""
SLOW, LOSING_M = 0.95, 0.5
"""Tractor speed divided by reference speed below which a slow tractor is reported [-], and minimum distance behind the
reference for this report [m]. Assumed values above the small lag that every start from rest causes."""


class Lag(NamedTuple):
    """Lag of the tractor behind its reference at the end of a run."""

    behind_m: float  # Distance of the tractor behind the reference [m], along the heading of the reference
    speed_m_s: float  # Mean speed of the tractor in the final part [m/s]
    reference_m_s: float  # Mean speed of the reference in the final part [m/s]

    @property
    def text(self) -> str:
        """Message about the lag, or an empty string if the lag is within the limits LATE_M, LOSING_M and SLOW."""
        found = []
        if abs(self.behind_m) > LATE_M:
            found.append(f"{abs(self.behind_m):.1f} m {'behind' if self.behind_m > 0 else 'ahead of'} its reference")
        if self.behind_m > LOSING_M and self.speed_m_s < SLOW * self.reference_m_s:
            found.append(f"at {self.speed_m_s:.2f} of {self.reference_m_s:.2f} m/s")
        return ", ".join(found)


def lag_of(log: LogLike) -> Lag | None:
    """Return the lag at the end of a run, or None if the log has fewer than two rows or the lag is not finite."""
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

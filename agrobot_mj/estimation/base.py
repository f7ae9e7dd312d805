"""What every estimator fills: measurement in, `Estimate` out, once per tick, and how its health is judged.

An estimator is frozen data with its keys under `[estimator]`. `init(x, y, yaw, tractor) -> state` and `update(state,
measurement, dt) -> (state, assumed value)`. `Health` is what can be said without the truth: the age of the newest
accepted fix, the stated uncertainty of the position, and the smoothed NIS. SI units and radians.
"""

from math import exp, sqrt
from typing import Any, NamedTuple

from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import Array, Column, Estimate, Measurement
from agrobot_mj.machine.tractor import TractorParameters

NIS_WINDOW_S = 5.0
"""Time constant of the smoothed NIS [s]. Assumed value: 100 fixes, over which a consistent filter stays below 2.6."""
NIS_MOST = 200.0
"""NIS beyond which an innovation counts no further towards the smoothed one [-]. Assumed value: fourteen sigma, so that
a single wild fix adds 2 to it, and wild fixes for five seconds 126."""


class Health(NamedTuple):
    """Diagnostics of an estimator that need no truth."""

    fix_t: float = 0.0
    """Time of the newest accepted fix, the start before the first [s]."""
    nis: float = 2.0
    """Smoothed NIS of the position, 2 if consistent [-]."""

    def after(self, nis: float, fix_t: float | None, dt: float) -> "Health":
        """Health after a tick with this NIS (NaN without a fix) and this time of the fix (None unless accepted) [s]."""
        keep = exp(-dt / NIS_WINDOW_S)
        smooth = keep * self.nis + (1.0 - keep) * min(nis, NIS_MOST) if nis == nis else self.nis
        return Health(self.fix_t if fix_t is None else fix_t, smooth)


def largest_sigma(covariance: Array) -> float:
    """Largest standard deviation of the position in any direction, from a covariance (n >= 2, n) [m]."""
    (p_xx, p_xy), (_, p_yy) = covariance[:2, :2].tolist()
    middle, half = 0.5 * (p_xx + p_yy), 0.5 * (p_xx - p_yy)
    return sqrt(middle + sqrt(half * half + p_xy * p_xy))


class StateEstimator(Reporting):
    """Base of all estimators; a kind overrides `init`, `update` and, to be logged, the other two."""

    kind: str

    @property
    def needs(self) -> dict[str, str]:
        """Sensors that the scenario must enable, each with the key that asks for it, as messages name it."""
        return {}

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> Any:
        """State before the first tick, at R = (x, y) [m] with heading `yaw` [rad]."""
        raise NotImplementedError

    def update(self, state: Any, measurement: Measurement, dt: float) -> tuple[Any, Estimate]:
        """State and estimate at the end of a tick of length `dt` [s], from what was measured in it."""
        raise NotImplementedError


HEALTH_COLUMNS = (
    Column("accepted_fix_age", "s", "age of the newest fix that the estimator accepted"),
    Column("position_sigma", "m", "stated standard deviation of R in the direction of its largest uncertainty"),
    Column("nis_mean", "-", "NIS of the position smoothed over 5 s, 2 if consistent"),
)
"""Columns of `Estimate.fix_age`, `position_sigma` and `nis_mean`."""

"""First look at a steering sensor of unknown centre, scale and sign: a line through its readings.

Wheels that roll without slip turn by atan(L r / u). That angle, as the yaw rate asks for it, is regressed on what
the sensor read some time before; the age that explains most is taken. It is where the fit starts, no result.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.columns import FieldLogError
from agrobot_mj.fieldlogs.recording import FieldRecording, TimeSeries
from agrobot_mj.fieldlogs.replay.residuals import moving

AGES_S = np.arange(-0.5, 1.5, 0.02)
"""Ages of the yaw rate behind the steering that are tried [s]."""
LEAST_EXPLAINED = 0.5
"""Share of the variance of the angle that a straight line must explain [-]. Estimate: sensors give 0.9 and more."""
LEAST_SAMPLES = 50
"""Least number of yaw rates."""
OUTLIER = 3.0
"""Distance from the line beyond which a sample counts no more, over a robust standard deviation [-]."""


class RoughSteering(NamedTuple):
    """Straight line between readings and wheel angle."""

    centre: float
    """Reading straight ahead [in the sensor's unit]."""
    scale: float
    """Wheel angle per reading, negative where readings grow to the right [rad per unit]."""
    age: float
    """Age of the yaw rate [s]."""
    explained: float
    """Share of the variance explained [-]."""

    def angle(self, recording: FieldRecording) -> FieldRecording:
        """A recording of readings as one of angles."""
        assert recording.steer is not None
        t, reading = recording.steer
        return recording._replace(steer=TimeSeries(t, self.scale * (reading - self.centre)))


def rough_steering(pieces: Sequence[FieldRecording], wheelbase: float) -> RoughSteering:
    """Regress the angle that pieces turn by on their readings. Raises `FieldLogError` where there is no line."""
    found = [part for part in (_turning(piece, wheelbase) for piece in pieces) if part is not None]
    name = pieces[0].name
    if sum(len(angle) for _, angle, _ in found) < LEAST_SAMPLES:
        raise FieldLogError(f"{name}: has hardly a yaw rate, heading or position at speed; name one in the map")
    angle, weight = (np.concatenate([part[k] for part in found]) for k in (1, 2))
    best = max(
        (_line(np.concatenate([part[0][k] for part in found]), angle, weight, float(age)))
        for k, age in enumerate(AGES_S)
    )
    if best[0] < LEAST_EXPLAINED:
        raise FieldLogError(
            f"{name}: a straight line through the readings of the steering explains {100 * max(best[0], 0):.0f} % of "
            "its turning; is [steer] the wheel angle, and does the log have bends to both sides?"
        )
    explained, scale, centre, age = best
    return RoughSteering(centre, scale, age, explained)


def _turning(piece: FieldRecording, wheelbase: float) -> tuple[Array, Array, Array] | None:
    """Readings at each age (ages, n), wheel angle without slip (n,) and weight (n,) of a piece; None without any."""
    assert piece.steer is not None
    if piece.yaw_rate is None or len((seen := moving(piece, piece.yaw_rate)).t) < 2:
        return None
    u = np.interp(seen.t, piece.speed.t, piece.speed.value)
    read = np.array([np.interp(seen.t - age, *piece.steer) for age in AGES_S])
    angle = np.arctan(wheelbase * seen.value / u)
    return read, angle, np.abs(u) * np.cos(angle) ** 2  # a yaw rate's noise is that of the angle over u cos2


def _line(reading: Array, angle: Array, weight: Array, age: float) -> tuple[float, float, float, float]:
    """Share explained by a line, its slope, its reading at zero, and the age; outliers left out once."""
    kept = np.ones(len(angle), dtype=bool)
    for _ in range(2):
        if np.ptp(reading[kept]) == 0.0:
            return 0.0, 1.0, 0.0, age
        slope, level = np.polyfit(reading[kept], angle[kept], 1, w=weight[kept])
        off = weight * (angle - slope * reading - level)
        kept = np.abs(off) < OUTLIER * 1.4826 * np.median(np.abs(off)) + 1e-12
    spread = weight * (angle - np.average(angle, weights=weight**2))
    return 1.0 - float((off**2).sum() / (spread**2).sum()), float(slope), float(-level / slope), age

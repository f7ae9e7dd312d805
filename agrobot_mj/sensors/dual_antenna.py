"""Heading from two antennas of one receiver, mounted side by side on the roof.

The receiver measures the vector from the right to the left antenna with millimetre accuracy. The heading is the
direction of this vector minus 90 degrees. Its error is the relative position error across the baseline divided by the
baseline length, plus a constant mounting error. The relative position error consists of white noise and a slow
first-order Gauss-Markov part [Brown2012], because the multipath differs between the antennas. With pitch theta and roll
phi the horizontal projection of the baseline points atan(sin(theta) tan(phi)) to the right of the axle direction. The
heading needs only fixed ambiguities between the antennas, and therefore continues without a base station [Jones2026].
"""

from math import atan, nan, radians, sin, tan
from typing import Annotated, ClassVar, NamedTuple

from pydantic import Field

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.kernels import jit
from agrobot_mj.core.randomness import Shares, gauss_markov_step, normal, shares
from agrobot_mj.core.signals import Quality
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.sensors.base import SensedMotion

FIX, DGPS = Quality.FIX, Quality.DGPS


class DualAntennaLaw(NamedTuple):
    """Parameters of the antenna pair, as numbers for compiled kernels."""

    enabled: bool
    baseline: float  # Distance between the antennas [m]
    sigma: float  # Standard deviation of the white noise of the relative position [m]
    slow: float  # Standard deviation of the slow relative position error [m]
    kept: Shares  # Weights of the last value and of new white noise in the slow error [-]
    mounting: float  # Constant mounting error of the heading [rad]


@jit
def antenna_heading(
    p: DualAntennaLaw, slow: float, generator: int, motion: SensedMotion, quality: int
) -> tuple[float, float]:
    """Return the new slow error, divided by its standard deviation [-], and the measured heading, wrapped [rad].

    The heading is NaN without a second antenna or without fixed ambiguities.
    """
    if not p.enabled:
        return slow, nan
    slow = gauss_markov_step(slow, p.kept, generator)
    aside = p.slow * slow + p.sigma * normal(generator)
    error = atan(aside / p.baseline) + p.mounting
    leaning = -atan(sin(motion.pitch) * tan(motion.roll))
    return slow, wrap(motion.yaw + leaning + error) if quality in (FIX, DGPS) else nan


class DualAntenna(Spec):
    """Second antenna on the roof for the heading (`[sensors.gnss.dual_antenna]`); absent on the paper's tractor."""

    sized: ClassVar = {"baseline_m": {"track": 1}}

    enabled: bool = False
    """Whether the second antenna is present; otherwise a fix has no heading."""
    baseline_m: Annotated[float, Field(ge=0.1, le=20)] = 1.0
    """Distance between the antennas [m]. Assumed value (range 0.5-1.5) for antennas at the sides of a roof."""
    sigma_m: NonNegative = 0.003
    """Standard deviation of the white noise in the relative position [m]. Assumed value (range 0.002-0.004) for
    carrier-phase positioning."""
    wander_sigma_m: NonNegative = 0.003
    """Standard deviation of the slow relative position error [m]. Assumed value (range 0.002-0.006) for multipath."""
    wander_time_s: Positive = 115.0
    """Correlation time of the slow position error [s]. Assumed value for short baselines [Miller2012]."""
    mounting_deg: float = 0.0
    """Constant mounting error of the heading [deg], positive to the left. Assumed value (up to 1 if uncalibrated)."""

    def parameters(self, dt: float) -> DualAntennaLaw:
        """Return the parameters of the kernel `antenna_heading` for ticks of length `dt` [s]."""
        return DualAntennaLaw(
            enabled=self.enabled,
            baseline=self.baseline_m,
            sigma=self.sigma_m,
            slow=self.wander_sigma_m,
            kept=shares(dt, self.wander_time_s),
            mounting=radians(self.mounting_deg),
        )

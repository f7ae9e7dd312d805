"""Heading from two antennas of one receiver, mounted across the roof.

The receiver measures the vector from the right to the left antenna within millimetres; its direction minus 90 degrees
is the heading. The error is the relative position error across the baseline divided by the baseline length, plus a
constant mounting error. The relative position error is white noise and a slow first-order Gauss-Markov part
[Brown2012], because the multipath differs between the antennas. With pitch theta and roll phi the horizontal projection
of the baseline points atan(sin(theta) tan(phi)) to the right of the axle direction. The heading needs fixed ambiguities
between the antennas only, and therefore continues without corrections of the base station [Jones2026].
"""

from math import atan, nan, radians, sin, tan
from typing import Annotated, ClassVar, NamedTuple

from pydantic import Field

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.randomness import GaussMarkov, stream
from agrobot_mj.core.signals import SOUND, Distortion, Quality, Truth
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class DualAntennaState(NamedTuple):
    """State of the antenna pair between two ticks."""

    wander: GaussMarkov
    """Slow error; its random stream also provides the white noise."""
    line: SignalLine = SignalLine()
    """Line that transmits the heading."""


class DualAntenna(Spec):
    """Second antenna on the roof, which the paper's tractor does not have; `[sensors.gnss.dual_antenna]`."""

    sized: ClassVar = {"baseline_m": {"track": 1}}

    enabled: bool = False
    """Whether the second antenna is present; otherwise a fix has no heading."""
    baseline_m: Annotated[float, Field(ge=0.1, le=20)] = 1.0
    """Distance between the antennas [m]. Assumed value (0.5-1.5: width of a roof)."""
    sigma_m: NonNegative = 0.003
    """White noise of the relative position across the baseline [m]. Assumed value (0.002-0.004: carrier phase)."""
    wander_sigma_m: NonNegative = 0.003
    """Standard deviation of the slow relative position error [m]. Assumed value (0.002-0.006: multipath)."""
    wander_time_s: Positive = 115.0
    """Correlation time of the slow error [s]. Assumed value: carrier phase on short baselines [Miller2012]."""
    mounting_deg: float = 0.0
    """Constant mounting error of the heading, left positive [deg]. Assumed value (up to 1 before calibration)."""

    def init(self, seed: int) -> DualAntennaState:
        """Return the state with a slow error sampled from its stationary distribution."""
        return DualAntennaState(GaussMarkov.stationary(stream(seed, "gnss.dual_antenna")))

    def measure(
        self, state: DualAntennaState, truth: Truth, quality: int, dt: float, distortion: Distortion = SOUND
    ) -> tuple[DualAntennaState, float]:
        """Return the wrapped heading [rad]; NaN without the second antenna or without fixed ambiguities."""
        if not self.enabled:
            return state, nan
        wander = state.wander.after(dt, self.wander_time_s)
        aside = self.wander_sigma_m * wander.value[0] + self.sigma_m * wander.generator.standard_normal()
        error = atan(aside / self.baseline_m) + radians(self.mounting_deg)
        leaning = -atan(sin(truth.pitch) * tan(truth.roll))
        heading = wrap(truth.yaw + leaning + error) if quality in (Quality.FIX, Quality.DGPS) else nan
        line, heading = state.line.carried(heading, distortion, dt)
        return DualAntennaState(wander, line), wrap(heading)

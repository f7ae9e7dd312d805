"""Heading from two antennas of one receiver, mounted across the roof.

The receiver measures the vector from the right antenna to the left one to millimetres; its direction minus 90 degrees
is the heading. The error is the relative position across the baseline (white noise, and a slow first-order Gauss-Markov
part [Brown2012], because the multipath differs between the antennas) divided by the baseline, plus a constant mounting
error. With simultaneous pitch theta and roll phi the horizontal projection of the baseline is atan(sin(theta) tan(phi))
to the right of the axle's. Needs fixed ambiguities between the antennas only, and therefore survives the loss of the
base station's corrections [Jones2026].
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
    """Both antennas between two ticks."""

    wander: GaussMarkov
    """Slow error; its stream gives the white one too."""
    line: SignalLine = SignalLine()
    """Line that carries the heading."""


class DualAntenna(Spec):
    """A second antenna on the roof, which the paper's tractor does not have; `[sensors.gnss.dual_antenna]`."""

    sized: ClassVar = {"baseline_m": {"track": 1}}

    enabled: bool = False
    """Whether the second antenna is present; otherwise a fix has no heading."""
    baseline_m: Annotated[float, Field(ge=0.1, le=20)] = 1.0
    """Distance between the antennas [m]. Assumed value (0.5-1.5, the width of a roof)."""
    sigma_m: NonNegative = 0.003
    """White error of one antenna to the other, across the baseline [m]. Assumed value (0.002-0.004: carrier phase)."""
    wander_sigma_m: NonNegative = 0.003
    """Slow error of one antenna from the other, also [m]. Assumed value (0.002-0.006: multipath)."""
    wander_time_s: Positive = 115.0
    """Correlation time of the slow error [s]. Assumed value: carrier phase on short baselines [Miller2012]."""
    mounting_deg: float = 0.0
    """Constant error of the mounting, left positive [deg]. Assumed value (up to 1 before calibration)."""

    def init(self, seed: int) -> DualAntennaState:
        """Return the slow error drawn from its stationary distribution."""
        return DualAntennaState(GaussMarkov.stationary(stream(seed, "gnss.dual_antenna")))

    def measure(
        self, state: DualAntennaState, truth: Truth, quality: int, dt: float, distortion: Distortion = SOUND
    ) -> tuple[DualAntennaState, float]:
        """Return the heading [rad], wrapped; NaN without antennas or without fixed ambiguities."""
        if not self.enabled:
            return state, nan
        wander = state.wander.after(dt, self.wander_time_s)
        aside = self.wander_sigma_m * wander.value[0] + self.sigma_m * wander.generator.standard_normal()
        error = atan(aside / self.baseline_m) + radians(self.mounting_deg)
        leaning = -atan(sin(truth.pitch) * tan(truth.roll))
        heading = wrap(truth.yaw + leaning + error) if quality in (Quality.FIX, Quality.DGPS) else nan
        line, heading = state.line.carried(heading, distortion, dt)
        return DualAntennaState(wander, line), wrap(heading)

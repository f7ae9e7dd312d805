"""Faults and disturbances of the machine and ground: valve wear, tyres, friction, payload, pull and side force."""

from math import exp, log1p, sqrt
from typing import Annotated, Literal

from numpy.random import Generator
from pydantic import Field

from agrobot_mj.core.randomness import GaussMarkov
from agrobot_mj.core.signals import WHEELS, Conditions, PointMass
from agrobot_mj.core.spec import Fraction, NonNegative, Positive, Scale, Spread
from agrobot_mj.faults.base import Scripted

Metres = Annotated[float, Field(ge=-20, le=20)]
Four = tuple[float, float, float, float]


def _scale_one(values: Four, i: int, share: float) -> Four:
    a, b, c, d = (value * share if k == i else value for k, value in enumerate(values))
    return a, b, c, d


class ValveWear(Scripted):
    """Worn steering valve: leakage past the spool, and a wider dead band on both sides."""

    kind: Literal["valve_wear"] = "valve_wear"
    gain_share: Fraction = 0.7
    """Remaining fraction of the valve flow at all voltages [-]. Assumed value (range 0.5-0.9, due to leakage past the
    spool)."""
    dead_band_v: Annotated[float, Field(ge=0, le=6)] = 0.4
    """Increase of the half width of the dead band [V]. Assumed value (range 0.2-0.8, 2-7 % of the voltage range)."""
    ramp_s: NonNegative = 0.0
    """Time over which the wear grows linearly from zero [s], or 0 for immediate wear."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Reduce the flow of the steering valve and widen its dead band."""
        grown = self.strength_at(t, self.ramp_s)
        gain = 1.0 - grown * (1.0 - self.gain_share)
        return None, conditions._replace(
            valve_gain=conditions.valve_gain * gain,
            valve_dead_band=conditions.valve_dead_band + grown * self.dead_band_v,
        )


class Friction(Scripted):
    """Scaled friction of the whole ground, as after rain or dew. The tyre law `linear` has no friction limit."""

    machine = True

    kind: Literal["friction"] = "friction"
    scale: Scale = 0.6
    """Factor on the friction [-]. Assumed value (range 0.5-0.7 for wet grass relative to dry ground)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Multiply the friction of the ground under all wheels by `scale`."""
        return None, conditions._replace(grip=conditions.grip * self.scale)


class SoftTyre(Scripted):
    """Tyre with low pressure: larger deflection, lower cornering stiffness and higher rolling resistance.

    The tyre kind `contact` has no carcass and is not affected.
    """

    machine = True

    kind: Literal["soft_tyre"] = "soft_tyre"
    wheel: Literal["fl", "fr", "rl", "rr"] = "rl"
    """Affected wheel: front (`f`) or rear (`r`), left (`l`) or right (`r`)."""
    stiffness_share: Annotated[float, Field(ge=0.15, le=1)] = 0.4
    """Remaining fraction of vertical and slip stiffness [-]. Assumed value (range 0.3-0.7) for about half the
    pressure."""
    rolling_share: Scale = 1.6
    """Factor on the rolling resistance [-]. Assumed value (range 1-2.5): inverse square root of the pressure ratio."""

    @property
    def subject(self) -> str:
        """Fault kind and affected wheel. Time windows for different wheels may overlap."""
        return f"{self.kind} {self.wheel}"

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Reduce the stiffness and increase the rolling resistance of the affected tyre."""
        i = WHEELS.index(self.wheel)
        return None, conditions._replace(
            tyre_stiffness=_scale_one(conditions.tyre_stiffness, i, self.stiffness_share),
            tyre_rolling=_scale_one(conditions.tyre_rolling, i, self.rolling_share),
        )


class Payload(Scripted):
    """Point mass attached to the chassis, such as a sprayer tank. Payloads at different positions add up."""

    machine = True

    kind: Literal["payload"] = "payload"
    mass_kg: Annotated[float, Field(ge=-1e4, le=1e4)] = 100.0
    """Mass of the payload [kg], negative for removed ballast. Assumed value (range 50-300 for a tank, -100 to 0 for
    front weights)."""
    ahead_m: Metres = -0.6
    """Distance of the mass ahead of the rear axle [m]. Assumed value for the three-point hitch; 2.2 m for a front
    loader."""
    left_m: Metres = 0.0
    """Lateral offset of the mass [m], positive to the left."""
    up_m: NonNegative = 0.7
    """Height of the mass above the ground [m]. Assumed value (range 0.5-1) for a load on the three-point hitch."""

    @property
    def subject(self) -> str:
        """Fault kind and position of the payload. Time windows for different positions may overlap."""
        return f"{self.kind} at {self.ahead_m:g}, {self.left_m:g}, {self.up_m:g} m"

    @property
    def load(self) -> PointMass:
        """Payload as a point mass attached to the chassis."""
        return PointMass(self.mass_kg, self.ahead_m, self.left_m, self.up_m)

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Add the point mass to the payloads of the tick."""
        added = (self.load,) if self.mass_kg else ()
        return None, conditions._replace(payload=conditions.payload + added)


class Drawbar(Scripted):
    """Pull of a plough, cultivator or trailer at the hitch, against the motion; constant or varying with the soil.

    The varying pull has a log-normal distribution with the mean `pull_n`, so that the pull is never negative.
    """

    machine = True

    kind: Literal["drawbar"] = "drawbar"
    pull_n: Annotated[float, Field(ge=0, le=1e5)] = 1500.0
    """Mean pull [N]. Assumed value (range 500-3000) for a light cultivator; tyre grip limits the pull to 4000 N."""
    noise_share: Spread = 0.0
    """Standard deviation of the pull divided by its mean [-]. Default: 0. Assumed value (range 0.1-0.3 in soil)."""
    noise_time_s: Positive = 0.5
    """Correlation time of the pull [s]. Assumed value: a soil correlation length of 0.5 m at a speed of 1 m/s."""

    def init(self, generator: Generator) -> GaussMarkov:
        """Return the initial variation of the pull, sampled from its stationary distribution."""
        return GaussMarkov.stationary(generator)

    def apply(self, state: GaussMarkov, conditions: Conditions, t: float, dt: float) -> tuple[GaussMarkov, Conditions]:
        """Add the pull, with its random variation, to the drawbar force on the tractor."""
        spread = log1p(self.noise_share**2)
        pull = self.pull_n * exp(sqrt(spread) * state.value[0] - spread / 2)
        return state.after(dt, self.noise_time_s), conditions._replace(drawbar=conditions.drawbar + pull)


class SideForce(Scripted):
    """Horizontal force on the CG, perpendicular to the heading: wind or side draught, constant or with gusts."""

    machine = True

    kind: Literal["side_force"] = "side_force"
    force_n: Annotated[float, Field(ge=-1e5, le=1e5)] = 300.0
    """Mean force to the left [N]. Assumed value for wind of 15 m/s on 2 m2; up to 1000 N for side draught."""
    gust_share: Spread = 0.0
    """Standard deviation of the force divided by its mean [-]. Default: 0. Assumed value (range 0.2-0.5 for wind)."""
    gust_time_s: Positive = 2.0
    """Correlation time of the gusts [s]. Assumed value (range 1-5)."""

    def init(self, generator: Generator) -> GaussMarkov:
        """Return the initial gust component of the force, sampled from its stationary distribution."""
        return GaussMarkov.stationary(generator)

    def apply(self, state: GaussMarkov, conditions: Conditions, t: float, dt: float) -> tuple[GaussMarkov, Conditions]:
        """Add the mean force and the gusts to the side force on the CG."""
        force = self.force_n * (1.0 + self.gust_share * state.value[0])
        return state.after(dt, self.gust_time_s), conditions._replace(side_force=conditions.side_force + force)

"""Electro-hydraulic steering: valve voltage to oil flow to steering rate.

Input 0-12 V, neutral at 6 V; output m3/s, positive steers left. A transport delay and a first-order spool lag
come before the static map (dead band, a gain for each direction, saturation at the pump's flow). Structure:
[Qiu1999]; limits 0-12 V and 12 l/min: paper, section V-B; the rest estimates inside the ranges of the literature
(delay 0.1-0.3 s, time constant 0.1-0.2 s, dead band 3-10 % of the range, 15-30 deg/s).

The flow at which the valve saturates is that of its section or what the pump has left for it: the pump's flow goes
with the engine's speed, and without a priority valve other consumers take theirs first. A valve without pressure
compensation is an orifice: its flow falls with the load as sqrt(1 - p / p_supply), p the pressure against the motion
[Merritt1967].

The cylinder is described by its displacement per radian at the bicycle's virtual wheel. The bicycle plant takes
it as rigid; the MuJoCo plant puts the trapped oil's spring between this rate and the wheels. Bore and arm set the
steering rate. What carries load is sized to the front axle where it is not given: relief pressure, stiffness, damping.
"""

from math import exp, inf, pi, sqrt
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import NEUTRAL_V, Array, Index
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.machine.linkage import UPRIGHT, Linkage
from agrobot_mj.machine.tractor import COMPACT, TractorParameters

FULL_RANGE_V = 12.0
"""Top of the voltage range of a valve [V]. Paper, section V-B."""
LITRE_PER_MINUTE = 1e-3 / 60
"""One litre per minute [m3/s]."""
RELIEF_MARGIN = 3.0
"""Relief torque divided by the torque that turns the wheels at standstill [-]. Assumed value: twice the front axle
load, and half as much again for rough ground and stops; 100 bar on a cylinder of the class."""
STIFFNESS, DAMPING = 5.0e4, 400.0
"""Oil column and linkage of the default tractor [N m/rad, N m s/rad]. Assumed value: oil about 2e5 in series with
linkage and hoses of about 7e4."""


class Valve(Spec):
    """The electro-hydraulic proportional valve and its pump.

    Flows that are not given go with the wheelbase, as the cylinder's arm does: machines of any size steer as fast.
    """

    sized: ClassVar = {key: {"length": 1} for key in ("pump_flow_l_min", "gain_left_l_min_v", "gain_right_l_min_v")}

    delay_s: Annotated[float, Field(ge=0, le=5)] = 0.10
    """Transport delay, rounded to physics steps [s]. Assumed value (0.1-0.3 in the literature)."""
    time_constant_s: Annotated[float, Field(gt=0, le=10)] = 0.10
    """Spool lag [s]. Assumed value (0.1-0.2 in the literature)."""
    dead_band_v: Annotated[float, Field(ge=0, lt=NEUTRAL_V)] = 0.40
    """Half width of the dead band about neutral [V]. Assumed value: 3.3 % of the range per side; 3-10 % published."""
    gain_left_l_min_v: Positive = 3.2
    """Flow per volt beyond the dead band, steering left [l/(min V)]. Assumed value: 4 V of it ask for all the flow."""
    gain_right_l_min_v: Positive = 2.8
    """Flow per volt beyond the dead band, steering right [l/(min V)]. Assumed value: rod side, 10-20 % less."""
    pump_flow_l_min: Positive = 12.0
    """Pump flow, at which the valve saturates both ways [l/min]. Paper, section V-B."""
    section_flow_l_min: Positive | None = None
    """Maximum flow of the valve section, if below that of the pump [l/min]. Default: that of the pump."""
    engine_speed_share: Annotated[float, Field(ge=0.1, le=1.5)] = 1.0
    """Engine and pump speed divided by the speed for `pump_flow_l_min` [-]. Idle: about 0.4."""
    other_flow_l_min: NonNegative = 0.0
    """Flow that other consumers take, a lift or a motor [l/min]."""
    priority: bool = True
    """Whether a priority valve supplies the steering first; otherwise other consumers take precedence."""
    supply_pressure_bar: Positive | None = None
    """Supply pressure of a valve without compensation, whose flow falls with the load [bar]. Default: compensated."""

    @property
    def largest_flow(self) -> float:
        """Maximum flow in both directions without load [l/min]."""
        left = self.pump_flow_l_min * self.engine_speed_share - (0.0 if self.priority else self.other_flow_l_min)
        return min(max(left, 0.0), inf if self.section_flow_l_min is None else self.section_flow_l_min)


class Cylinder(Spec):
    """Steering cylinder, as seen at the bicycle's virtual wheel; by default its lever arm scales with the wheelbase."""

    sized: ClassVar = {"arm_m": {"length": 1}}

    bore_mm: Positive = 63.0
    """Bore of the cylinder [mm]. Assumed value (50-70 for the class)."""
    rod_mm: Positive = 25.0
    """Diameter of the rod [mm]. Assumed value (20-32); the mean of both piston areas counts."""
    arm_m: Positive = 0.155
    """Mean lever arm about the kingpins [m]. Assumed value (0.12-0.18): with the bore it sets the steering rate."""
    relief_pressure_bar: Positive | None = None
    """Pressure at which the relief valve opens [bar]. Default: three times the pressure that turns the wheels at
    standstill."""
    stiffness_n_m_rad: Positive | None = None
    """Stiffness of trapped oil, hoses and linkage in series [N m/rad]. Default: proportional to load times width of the
    front tyres, 5e4 for the compact tractor."""
    damping_n_m_s_rad: NonNegative | None = None
    """Damping of linkage and seals [N m s/rad]. Default: scaled like the stiffness, 400 for the compact tractor."""

    @model_validator(mode="after")
    def _rod_inside_the_bore(self) -> "Cylinder":
        if self.rod_mm >= self.bore_mm:
            raise ValueError(f"rod_mm: must be below bore_mm ({self.bore_mm:g}), got {self.rod_mm:g}")
        return self

    @property
    def area(self) -> float:
        """Mean effective piston area [m2]."""
        bore, rod = self.bore_mm * 1e-3, self.rod_mm * 1e-3
        return pi / 4 * (bore**2 - rod**2 / 2)

    @property
    def displacement(self) -> float:
        """Oil volume per radian of the virtual wheel [m3/rad]."""
        return self.area * self.arm_m

    def column(self, tractor: TractorParameters, linkage: Linkage = UPRIGHT) -> "OilColumn":
        """Return the oil column between valve and wheels, with given values or scaled to a tractor's front axle."""
        bar, share = self.relief_pressure_bar, tractor.front_axle_load / COMPACT.front_axle_load
        size = share * tractor.front_wheel_width_m / COMPACT.front_wheel_width_m
        sized = RELIEF_MARGIN * linkage.parked_torque(tractor)
        return OilColumn(
            relief_torque=sized if bar is None else bar * 1e5 * self.displacement,
            stiffness=STIFFNESS * size if self.stiffness_n_m_rad is None else self.stiffness_n_m_rad,
            damping=DAMPING * size if self.damping_n_m_s_rad is None else self.damping_n_m_s_rad,
        )


class OilColumn(NamedTuple):
    """Oil of the steering cylinder, with hoses and linkage, about the virtual kingpin."""

    relief_torque: float
    """Maximum torque [N m]."""
    stiffness: float
    """Stiffness [N m/rad]."""
    damping: float
    """Damping [N m s/rad]."""


class ValveLaw(NamedTuple):
    """A `Valve` in SI units, as the compiled kernel takes it."""

    lag: float
    """Fraction of a step that the spool keeps, exp(-dt / time constant) [-]."""
    dead_band: float
    """Half width of the dead band about neutral [V]."""
    gain_left: float
    """Flow per volt beyond the dead band, steering left [m3/(s V)]."""
    gain_right: float
    """Flow per volt beyond the dead band, steering right [m3/(s V)]."""
    saturation: float
    """Maximum flow, in both directions [m3/s]."""
    supply: float = 0.0
    """Pressure ahead of a valve without compensation; 0 for one with it [Pa]."""


class ValveMemory(NamedTuple):
    """State of the valve between steps; the arrays are written in place."""

    spool: Array
    """Lagged voltage at the spool, shape (1,) [V]."""
    queue: Array
    """Ring buffer of the delayed voltages, shape (delay steps + 1,) [V]."""
    head: Index
    """Index at which the ring buffer is written next, shape (1,)."""


def valve_law(valve: Valve, dt: float) -> tuple[ValveLaw, ValveMemory]:
    """Return the kernel's parameters and its initial state, for steps of `dt` [s]."""
    law = ValveLaw(
        lag=exp(-dt / valve.time_constant_s),
        dead_band=valve.dead_band_v,
        gain_left=valve.gain_left_l_min_v * LITRE_PER_MINUTE,
        gain_right=valve.gain_right_l_min_v * LITRE_PER_MINUTE,
        saturation=valve.largest_flow * LITRE_PER_MINUTE,
        supply=1e5 * (valve.supply_pressure_bar or 0.0),
    )
    queue = np.full(round(valve.delay_s / dt) + 1, NEUTRAL_V)
    return law, ValveMemory(np.array([NEUTRAL_V]), queue, np.zeros(1, dtype=np.int64))


def reset_valve(memory: ValveMemory) -> None:
    """Set spool and delay line to neutral."""
    memory.spool[:], memory.queue[:], memory.head[:] = NEUTRAL_V, NEUTRAL_V, 0


def worn_valve(law: ValveLaw, gain: float, dead_band: float) -> ValveLaw:
    """Return the valve with a fraction `gain` [-] of its flow and a dead band wider by `dead_band` [V] per side."""
    if gain == 1.0 and dead_band == 0.0:
        return law
    return law._replace(
        dead_band=law.dead_band + dead_band,
        gain_left=gain * law.gain_left,
        gain_right=gain * law.gain_right,
        saturation=gain * law.saturation,
    )


@kernel
def static_flow(law: ValveLaw, voltage: float) -> float:
    """Return the steady flow [m3/s] at a spool voltage [V]: dead band, gain by direction, saturation."""
    v = voltage - NEUTRAL_V
    if v > law.dead_band:
        return min(law.gain_left * (v - law.dead_band), law.saturation)
    if v < -law.dead_band:
        return max(law.gain_right * (v + law.dead_band), -law.saturation)
    return 0.0


@kernel
def valve_step(law: ValveLaw, memory: ValveMemory, voltage: float) -> float:
    """Advance the valve by one step under `voltage` [V]; returns the flow [m3/s]."""
    n = memory.queue.shape[0]
    head = memory.head[0]
    memory.queue[head] = min(max(voltage, 0.0), FULL_RANGE_V)
    memory.head[0] = (head + 1) % n
    delayed = memory.queue[memory.head[0]]
    memory.spool[0] = delayed + law.lag * (memory.spool[0] - delayed)
    return static_flow(law, memory.spool[0])


@kernel
def loaded_flow(law: ValveLaw, flow: float, pressure: float) -> float:
    """Return the flow [m3/s] of a valve at a cylinder `pressure` that pushes left [Pa]: reduced against, increased with
    it."""
    if law.supply <= 0.0 or flow == 0.0:
        return flow
    against = pressure if flow > 0.0 else -pressure
    flow = flow * sqrt(max(1.0 - against / law.supply, 0.0))
    return min(max(flow, -law.saturation), law.saturation)


@kernel
def beyond_play(deflection: float, play: float) -> float:
    """Return the part of a deflection outside a play of that half width, in the same unit."""
    if deflection > play:
        return deflection - play
    if deflection < -play:
        return deflection + play
    return 0.0

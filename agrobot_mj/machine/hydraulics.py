"""Electro-hydraulic steering: from valve voltage through oil flow to steering rate.

The input is 0-12 V, neutral at 6 V; the output is a flow in m3/s, positive to the left. A transport delay and a
first-order spool lag precede a static characteristic with dead band, a gain for each direction, and saturation. The
structure is from [Qiu1999]; the limits 0-12 V and 12 l/min are from the paper, section V-B. The other values are
assumed within the ranges of the literature: delay 0.1-0.3 s, time constant 0.1-0.2 s, dead band 3-10 % of the voltage
range, steering rate 15-30 deg/s.

The flow saturates at the limit of the valve section or at the available pump flow. The pump flow is proportional to the
engine speed; without a priority valve other consumers are supplied first. A valve without pressure compensation is an
orifice: its flow decreases as sqrt(1 - p / p_supply), where the pressure p opposes the motion [Merritt1967].

The cylinder is described by its displacement per radian at the bicycle model's virtual wheel. The bicycle plant has a
rigid cylinder; the MuJoCo plant adds the spring of the trapped oil. Bore and lever arm determine the steering rate. By
default relief pressure, stiffness and damping follow from the front axle load and the front tyre width.
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

FULL_RANGE_V = 12.0  # Maximum voltage of a valve [V]. Paper, section V-B.
LITRE_PER_MINUTE = 1e-3 / 60  # Conversion factor from l/min to m3/s [m3/s per l/min]
RELIEF_MARGIN = 3.0
"""Relief torque divided by the torque that steers the wheels at standstill [-]. Assumed value: 2 (doubled axle load)
times 1.5 (rough ground and end stops). The resulting relief pressure of the compact tractor is 8 bar."""
STIFFNESS, DAMPING = 5.0e4, 400.0
"""Stiffness [N m/rad] and damping [N m s/rad] of the compact tractor's steering. Assumed values: stiffness of the oil
column (about 2e5) in series with linkage and hoses (about 7e4)."""


class Valve(Spec):
    """Electro-hydraulic proportional valve of the steering, and its pump.

    Default flows scale with the wheelbase, like the lever arm of the cylinder, so that all machines steer equally fast.
    """

    sized: ClassVar = {key: {"length": 1} for key in ("pump_flow_l_min", "gain_left_l_min_v", "gain_right_l_min_v")}

    delay_s: Annotated[float, Field(ge=0, le=5)] = 0.10
    """Transport delay of the valve, rounded to physics steps [s]. Assumed value (range 0.1-0.3 in the literature)."""
    time_constant_s: Annotated[float, Field(gt=0, le=10)] = 0.10
    """Time constant of the valve spool [s]. Assumed value (range 0.1-0.2 in the literature)."""
    dead_band_v: Annotated[float, Field(ge=0, lt=NEUTRAL_V)] = 0.40
    """Half width of the dead band about neutral [V]. Assumed value: 3.3 % of the voltage range (literature: 3-10 %)."""
    gain_left_l_min_v: Positive = 3.2
    """Flow to the left per volt outside the dead band [l/(min V)]. Assumed value: full flow at 4 V from neutral."""
    gain_right_l_min_v: Positive = 2.8
    """Flow to the right per volt outside the dead band [l/(min V)]. Assumed value: 10-20 % below the left gain."""
    pump_flow_l_min: Positive = 12.0
    """Pump flow [l/min]; the valve saturates at this flow in both directions. Paper, section V-B."""
    section_flow_l_min: Positive | None = None
    """Maximum flow of the valve section [l/min]. Default: limited only by the pump."""
    engine_speed_share: Annotated[float, Field(ge=0.1, le=1.5)] = 1.0
    """Engine speed divided by the engine speed that gives `pump_flow_l_min` [-]; about 0.4 when the engine idles."""
    other_flow_l_min: NonNegative = 0.0
    """Flow to other consumers, such as a lift or a hydraulic motor [l/min]."""
    priority: bool = True
    """Whether a priority valve supplies the steering first; otherwise the other consumers are supplied first."""
    supply_pressure_bar: Positive | None = None
    """Supply pressure of a valve without pressure compensation [bar]. Default: the valve has pressure compensation."""

    @property
    def largest_flow(self) -> float:
        """Maximum flow of the valve in either direction at zero cylinder pressure [l/min]."""
        left = self.pump_flow_l_min * self.engine_speed_share - (0.0 if self.priority else self.other_flow_l_min)
        return min(max(left, 0.0), inf if self.section_flow_l_min is None else self.section_flow_l_min)


class Cylinder(Spec):
    """Steering cylinder, referred to the virtual front wheel. By default the lever arm scales with the wheelbase."""

    sized: ClassVar = {"arm_m": {"length": 1}}

    bore_mm: Positive = 63.0
    """Bore diameter of the cylinder [mm]. Assumed value (range 50-70 for compact tractors)."""
    rod_mm: Positive = 25.0
    """Diameter of the piston rod [mm]; the model uses the mean of both piston areas. Assumed value (range 20-32)."""
    arm_m: Positive = 0.155
    """Mean lever arm of the cylinder about the kingpins [m]; arm and bore determine the steering rate. Assumed value
    (range 0.12-0.18)."""
    relief_pressure_bar: Positive | None = None
    """Pressure at which the relief valve opens [bar]. Default: 3 times the pressure that turns the parked wheels."""
    stiffness_n_m_rad: Positive | None = None
    """Stiffness of trapped oil, hoses and linkage in series [N m/rad]. Default: proportional to front axle load times
    front tyre width; 5e4 for the compact tractor."""
    damping_n_m_s_rad: NonNegative | None = None
    """Damping of linkage and seals [N m s/rad]. Default: proportional to the stiffness, 400 for the compact tractor."""

    @model_validator(mode="after")
    def _check_rod(self) -> "Cylinder":
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
        """Oil volume displaced by the cylinder per radian of the virtual front wheel's angle [m3/rad]."""
        return self.area * self.arm_m

    def column(self, tractor: TractorParameters, linkage: Linkage = UPRIGHT) -> "OilColumn":
        """Return the properties of the oil column. Defaults scale with front axle load and front tyre width."""
        bar, share = self.relief_pressure_bar, tractor.front_axle_load / COMPACT.front_axle_load
        size = share * tractor.front_wheel_width_m / COMPACT.front_wheel_width_m
        sized = RELIEF_MARGIN * linkage.parked_torque(tractor)
        return OilColumn(
            relief_torque=sized if bar is None else bar * 1e5 * self.displacement,
            stiffness=STIFFNESS * size if self.stiffness_n_m_rad is None else self.stiffness_n_m_rad,
            damping=DAMPING * size if self.damping_n_m_s_rad is None else self.damping_n_m_s_rad,
        )


class OilColumn(NamedTuple):
    """Steering cylinder, hoses and linkage as a rotary spring at the virtual front wheel."""

    relief_torque: float  # Maximum torque of the cylinder [N m], at which the relief valve opens
    stiffness: float  # Stiffness of oil column and linkage [N m/rad]
    damping: float  # Damping of oil column and linkage [N m s/rad]


class ValveLaw(NamedTuple):
    """Parameters of a `Valve` for the compiled function `valve_step`, in SI units."""

    lag: float  # Fraction of the deviation of the spool that remains after a step, exp(-dt / time constant) [-]
    dead_band: float  # Half width of the dead band about neutral [V]
    gain_left: float  # Flow per volt outside the dead band, steering left [m3/(s V)]
    gain_right: float  # Flow per volt outside the dead band, steering right [m3/(s V)]
    saturation: float  # Maximum flow [m3/s], in both directions
    supply: float = 0.0  # Supply pressure of a valve without pressure compensation [Pa], or 0 for a compensated valve


class ValveMemory(NamedTuple):
    """Delayed voltages and spool state of the valve between two physics steps, in arrays that `valve_step` modifies."""

    spool: Array  # Voltage after the spool lag [V], shape (1,)
    queue: Array  # Ring buffer of the input voltages during the delay [V], shape (delay steps + 1,)
    head: Index  # Index of the next element to write in the ring buffer, shape (1,)


def valve_law(valve: Valve, dt: float) -> tuple[ValveLaw, ValveMemory]:
    """Return the parameters and the initial state of `valve_step`, for physics steps of `dt` [s]."""
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
    """Set the spool and the buffer of delayed voltages to neutral."""
    memory.spool[:], memory.queue[:], memory.head[:] = NEUTRAL_V, NEUTRAL_V, 0


def worn_valve(law: ValveLaw, gain: float, dead_band: float) -> ValveLaw:
    """Return the law of a worn valve: flow times `gain` [-], and dead band widened by `dead_band` [V] on each side."""
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
    """Return the steady-state flow [m3/s] at a spool voltage [V], from dead band, directional gain and saturation."""
    v = voltage - NEUTRAL_V
    if v > law.dead_band:
        return min(law.gain_left * (v - law.dead_band), law.saturation)
    if v < -law.dead_band:
        return max(law.gain_right * (v + law.dead_band), -law.saturation)
    return 0.0


@kernel
def valve_step(law: ValveLaw, memory: ValveMemory, voltage: float) -> float:
    """Advance the valve by one physics step at the input `voltage` [V], and return the oil flow [m3/s]."""
    n = memory.queue.shape[0]
    head = memory.head[0]
    memory.queue[head] = min(max(voltage, 0.0), FULL_RANGE_V)
    memory.head[0] = (head + 1) % n
    delayed = memory.queue[memory.head[0]]
    memory.spool[0] = delayed + law.lag * (memory.spool[0] - delayed)
    return static_flow(law, memory.spool[0])


@kernel
def loaded_flow(law: ValveLaw, flow: float, pressure: float) -> float:
    """Return the flow [m3/s] of a valve at a cylinder `pressure` [Pa]; `flow` [m3/s] is the flow at zero pressure.

    A positive pressure pushes the wheels to the left.
    """
    if law.supply <= 0.0 or flow == 0.0:
        return flow
    against = pressure if flow > 0.0 else -pressure
    flow = flow * sqrt(max(1.0 - against / law.supply, 0.0))
    return min(max(flow, -law.saturation), law.saturation)


@kernel
def beyond_play(deflection: float, play: float) -> float:
    """Return the deflection beyond a play of half width `play`, or 0 within the play, in the unit of the deflection."""
    if deflection > play:
        return deflection - play
    if deflection < -play:
        return deflection + play
    return 0.0

"""Electro-hydraulic steering, measured at the wheels

At 1.2 m/s, constant voltages give steady steering rates. Plotted versus voltage, the rates form two lines and a
plateau. The zero crossings of the lines are the dead band, their slopes are the gains, and the plateau is the rate
limit. A voltage step gives the delay and the time constant, by a least-squares fit of the valve law to the steering
angle. In MuJoCo, the oil column increases the delay by 8 ms, its damping divided by its stiffness.

The cylinder pressure depends on the load. On a parked tractor, the pressure must twist two contact patches; rolling
removes this twist. A torque on the wheels above the relief torque rotates them at the relief pressure. After five
seconds at a stop, the steering must leave the stop as quickly as with a rigid cylinder, without wind-up.
"""

from collections.abc import Iterator
from math import exp, log, radians
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import curve_fit

from agrobot_mj.core.signals import NEUTRAL_V, Array
from agrobot_mj.extensions.bench.manoeuvres.base import BICYCLE, Check, Trial, force_tyres, tyre_of
from agrobot_mj.machine.hydraulics import FULL_RANGE_V, LITRE_PER_MINUTE, Cylinder, Valve, static_flow, valve_law
from agrobot_mj.machine.linkage import DRY_GRIP
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import ORIGIN, REST, STOCK, Driver, Trace
from agrobot_mj.tyres import Linear

SPEED_M_S = 1.2
RAMP_V = (0.5, 1.0, 2.0, 3.0)  # Voltages relative to neutral, above the dead band and below saturation [V]
STEP_V = 3.0  # Voltage of the step [V], relative to neutral
STATIC_BAND, TIME_BAND, DELAY_BAND_S = 0.02, 0.05, 0.005
"""Acceptance limits of dead band, gains and rate limit [relative], of the time constant [relative], and of the delay
[s], which is 2.5 physics steps."""
PHYSICS_S = 0.002


class ValveResponse(NamedTuple):
    """Valve parameters identified for steering to one side."""

    dead_band_v: float
    gain_l_min_v: float
    rate_limit_rad_s: float
    delay_s: float
    time_constant_s: float


def angles(trace: Trace) -> Array:
    """Return the steering angles at all physics steps of a simulated `Trace` [rad]."""
    return np.concatenate([truth.steer_samples for truth in trace.truths])


def rolling(plant: Any, speed: float) -> Driver:
    """Return the `Driver` of a tractor that rolls straight ahead at `speed` [m/s], with the valve in neutral."""
    driver = Driver(plant, plant.reset(ORIGIN), speed)
    driver.go(3.0)
    driver.go_by_voltage(1.0, NEUTRAL_V)
    return driver


def steady_rate(plant: Any, volts: float) -> float:
    """Return the steady steering rate [rad/s] at a valve voltage relative to neutral [V]."""
    seen = angles(rolling(plant, SPEED_M_S).go_by_voltage(1.2, NEUTRAL_V + volts))
    late = seen[round(0.8 / PHYSICS_S) :]
    return float(np.polyfit(PHYSICS_S * np.arange(late.size), late, 1)[0])


def step_response(t: Array, delay: float, tau: float, gain: float, dead_band: float) -> Array:
    """Return the angle [rad] after a step of `STEP_V`: gain times integral of the voltage beyond the dead band."""
    begins = -tau * log(1 - dead_band / STEP_V)
    s = np.maximum(t - delay, begins)
    swept: Array = (STEP_V - dead_band) * (s - begins) - STEP_V * tau * (exp(-begins / tau) - np.exp(-s / tau))
    return gain * swept


def measure(plant: Any, side: int, displacement: float) -> ValveResponse:
    """Return the valve parameters for one side (1 left, -1 right), identified from steering angles."""
    flows = [side * steady_rate(plant, side * v) * displacement / LITRE_PER_MINUTE for v in RAMP_V]
    gain, offset = np.polyfit(RAMP_V, flows, 1)
    limit = side * steady_rate(plant, side * FULL_RANGE_V / 2)
    seen = angles(rolling(plant, SPEED_M_S).go_by_voltage(0.6, NEUTRAL_V + side * STEP_V))
    t, dead_band = PHYSICS_S * np.arange(1, seen.size + 1), -offset / gain
    guess = (0.08, 0.08, gain * LITRE_PER_MINUTE / displacement)
    (delay, tau, _), _ = curve_fit(
        lambda t, delay, tau, gain: step_response(t, delay, tau, gain, dead_band), t, side * (seen - seen[0]), guess
    )
    return ValveResponse(dead_band, gain, limit, delay, tau)


def oil_column(subject: str) -> float:
    """Return the delay due to the compliance of the cylinder [s], which is 0 for the bicycle model."""
    column = STOCK.cylinder.column(STOCK.tractor)
    return 0.0 if subject == BICYCLE else column.damping / column.stiffness


def identification(m: Trial, subject: str, plant: Any) -> Iterator[Check]:
    """Yield checks of the valve parameters identified for steering to the left and to the right."""
    valve, cylinder = Valve(), Cylinder()
    limit = valve.pump_flow_l_min * LITRE_PER_MINUTE / cylinder.displacement
    judged = subject == BICYCLE or tyre_of(subject).judged
    for name, side, gain in (("left", 1, valve.gain_left_l_min_v), ("right", -1, valve.gain_right_l_min_v)):
        found = measure(plant, side, cylinder.displacement)
        for quantity, unit, measured, wanted, band in (
            ("dead band", "V", found.dead_band_v, valve.dead_band_v, STATIC_BAND),
            ("gain", "l/(min V)", found.gain_l_min_v, gain, STATIC_BAND),
            ("rate limit", "rad/s", found.rate_limit_rad_s, limit, STATIC_BAND),
            ("time constant", "s", found.time_constant_s, valve.time_constant_s, TIME_BAND),
        ):
            yield m.about(f"{quantity}, {name}", subject, unit).near(measured, wanted, band).judged(judged)
        delay = m.about(f"delay, {name}", subject, "s")
        yield delay.close(found.delay_s, valve.delay_s + oil_column(subject), DELAY_BAND_S).judged(judged)


def turning_pressure(plant: MujocoPlant, speed: float) -> float:
    """Return the mean cylinder pressure [bar] while steering left at a steady rate with sliding contact patches."""
    driver = rolling(plant, speed)
    driver.go_by_voltage(1.0, NEUTRAL_V + 2.0)
    return float(np.mean(driver.pressures(0.5, NEUTRAL_V + 2.0))) / 1e5


def load_dependence(m: Trial, tyre: Any, plant: MujocoPlant) -> Iterator[Check]:
    """Yield checks of the cylinder pressure while a parked and a rolling tractor are steered."""
    tyres, front = plant.tyred.tyres, plant.tractor.front_axle_load
    patch, twisting = tyres.patch_half_length[0], DRY_GRIP * front * tyres.scrub_arm[0] / Cylinder().displacement / 1e5
    parked, rolled = turning_pressure(plant, 0.0), turning_pressure(plant, SPEED_M_S)
    still = m.about("pressure to turn the wheels, parked", tyre.kind, "bar")
    yield still.near(parked, twisting, 0.05) if patch > 0 else still.reported(parked)
    yield (
        m.about("parked pressure divided by rolling pressure", tyre.kind).above(parked / rolled, 1.5).judged(patch > 0)
    )


def relief(m: Trial, tyre: Any) -> Check:
    """Return a check of the mean cylinder pressure while an external torque pushes the wheels from 5 to 30 degrees.

    The torque is 1.6 times the relief torque, because scrubbing tyres carry a third of the relief torque in addition to
    the oil.
    """
    plant, _ = m.mujoco(tyre, tick_s=PHYSICS_S)
    torque = STOCK.cylinder.column(STOCK.tractor).relief_torque
    plant.data.qfrc_applied[plant.model.joint("steer").dofadr[0]] = 1.6 * torque
    pressures: list[float] = []
    for _ in range(round(1.0 / PHYSICS_S)):
        if radians(5.0) < plant.advance(REST).steer < radians(30.0):
            pressures.append(abs(plant.actuation()[1]) / 1e5)
    about = m.about("pressure at relief", tyre.kind, "bar")
    return about.near(float(np.mean(pressures)), torque / Cylinder().displacement / 1e5, 0.01)


def leaving(seen: Array, stop: float) -> float:
    """Return the time from the valve reversal until the steering angle is 2 degrees away from its stop [s]."""
    return PHYSICS_S * (1 + int(np.argmax(np.abs(seen) < stop - radians(2.0))))


def rigid_leaving(side: int) -> float:
    """Return the theoretical time for leaving a stop by 2 degrees with a rigid cylinder [s]."""
    valve, displacement = Valve(), Cylinder().displacement
    law, _ = valve_law(valve, PHYSICS_S)
    swept, s = 0.0, 0.0
    while swept < radians(2.0):
        s += 1e-4
        volts = NEUTRAL_V - side * NEUTRAL_V * (1 - 2 * exp(-s / valve.time_constant_s))
        swept += max(0.0, -side * static_flow(law, volts)) / displacement * 1e-4
    return valve.delay_s + s


def stops(m: Trial, subject: str, plant: Any) -> Iterator[Check]:
    """Yield checks of the steering angle at each stop under full flow, and of the time to leave the stop."""
    for name, side in (("left", 1), ("right", -1)):
        driver = Driver(plant, plant.reset(ORIGIN))
        held = float(angles(driver.go_by_voltage(5.0, NEUTRAL_V + side * NEUTRAL_V))[-1])
        left = angles(driver.go_by_voltage(0.6, NEUTRAL_V - side * NEUTRAL_V))
        about = m.about(f"angle at the stop, {name}", subject, "deg")
        yield about.close(float(np.degrees(side * held)), float(np.degrees(plant.tractor.steer_limit)), 0.2)
        about = m.about(f"time to leave the stop, {name}", subject, "s")
        yield about.close(leaving(left, side * held), rigid_leaving(side) + oil_column(subject), 0.01)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the valve with every plant, and of the cylinder with every tyre. Quick mode tests the valve only
    with the bicycle and `linear`."""
    plants = m.level_plants(only_linear=m.quick)
    for subject, plant, _ in plants:
        yield from identification(m, subject, plant)
    for subject, plant, _ in plants:
        if subject in (BICYCLE, Linear().kind):
            yield from stops(m, subject, plant)
    for tyre in force_tyres():
        yield from load_dependence(m, tyre, m.mujoco(tyre)[0])
        yield relief(m, tyre)

"""Step steer, after ISO 7401

At 4 m/s, a voltage pulse steers the wheels to 3 degrees, nearly as fast as the hydraulics allow. The steady yaw rate
divided by the steering angle is the kinematic value u / L (speed divided by wheelbase), reduced by slip. The theory
solves the balance of forces and moments in the bend for the curvature.

The response time is measured from half the steering angle to 90 % of the yaw rate. The tyres of the bicycle respond at
once; other tyres respond over their relaxation length sigma, 0.42 m in front and 0.63 m behind, which delays the yaw
rate and then causes overshoot. For `linear`, the theory is the bicycle with relaxation and roll for the measured
steering angle:

    sigma ds/dt = w - u s,   F = -C s,   w_f = v + l_f gamma - u delta,   w_r = v - l_r gamma

with the slip s, sliding velocity w, side force F and cornering stiffness C of an axle (f front, r rear), lateral speed
v, yaw rate gamma, and steering angle delta. The body rolls on the rear tyres about the line from the rear contact
patches to the pivot of the front axle. The front axle, whose pivot is at the height h_P, rolls on the front tyres of
the stiffness k_f and track T. This roll increases the relaxation length of the front axle by C_f h_P^2 / (k_f T^2 / 2).
"""

from collections.abc import Iterator
from math import radians
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lsim

from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Array, Truth
from agrobot_mj.extensions.bench.manoeuvres.base import BICYCLE, Check, Trial, tyre_of
from agrobot_mj.extensions.bench.manoeuvres.cornering import paper_gradient
from agrobot_mj.extensions.bench.manoeuvres.theory import STOCK, Tractor, parts
from agrobot_mj.machine.hydraulics import FULL_RANGE_V, Cylinder, Valve, valve_law, valve_step
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants.driver import Driver
from agrobot_mj.tyres import Linear

SPEED_M_S, STEER = 4.0, radians(3.0)
PULSE_S, PHYSICS_S = 3 * TICK_S, 0.002
BAND = 0.02  # Acceptance limit of the steady gain and of the RMS yaw-rate deviation [relative]
TRANSIENT_BAND = 0.10
"""Acceptance limit of the overshoot [relative]. The limit is wide, because the overshoot is a small difference of yaw
rates."""


class Step(NamedTuple):
    """Response of a plant to a steering step, starting at the tick of the step."""

    t: Array  # Time since the step [s]
    steer: Array  # Steering angle [rad]
    yaw_rate: Array  # Yaw rate [rad/s]
    gain: float  # Steady yaw rate divided by steering angle [1/s]

    @property
    def response_s(self) -> float:
        """Time from half of the final steering angle to 90 % of the final yaw rate [s]."""
        return rise(self.t, self.yaw_rate, 0.9) - rise(self.t, self.steer, 0.5)

    @property
    def overshoot(self) -> float:
        """Overshoot of the yaw rate divided by the steady yaw rate [-]."""
        steady = self.yaw_rate[-40:].mean()
        return float(self.yaw_rate.max() / steady - 1)


def rise(t: Array, values: Array, share: float) -> float:
    """Return the time at which `values` first reach the fraction `share` of their final value [s], by interpolation."""
    level = share * values[-40:].mean()
    k = int(np.argmax(values >= level))
    return float(np.interp(level, values[k - 1 : k + 1], t[k - 1 : k + 1])) if k else float(t[0])


def swept_angle(voltage: float) -> float:
    """Return the final steering angle after a pulse of the valve voltage, for a rigid cylinder [rad]."""
    law, memory = valve_law(Valve(), PHYSICS_S)
    volume = 0.0
    for k in range(round((PULSE_S + 1.0) / PHYSICS_S)):
        volume += PHYSICS_S * valve_step(law, memory, voltage if k * PHYSICS_S < PULSE_S else NEUTRAL_V)
    return volume / Cylinder().displacement


def pulse_voltage() -> float:
    """Return the voltage of the pulse that steers the wheels to the angle `STEER` [V]."""
    return float(brentq(lambda voltage: swept_angle(voltage) - STEER, NEUTRAL_V, FULL_RANGE_V, xtol=1e-3))


def step(plant: Any, truth: Truth, seconds: float) -> Step:
    """Drive straight until the speed is steady, apply a steering step, and return the response."""
    driver = Driver(plant, truth, SPEED_M_S)
    driver.go(10.0)
    driver.go_by_voltage(0.5, NEUTRAL_V)
    begun = driver.go_by_voltage(PULSE_S, pulse_voltage())
    rested = driver.go_by_voltage(0.4, NEUTRAL_V)
    trimmed = driver.go(seconds, STEER)
    trace = begun + rested + trimmed
    u = trace.mean("speed", 2.0)
    gain = trace.mean("yaw_rate", 2.0) / trace.mean("steer", 2.0) * SPEED_M_S / u
    t = np.array([TICK_S * (k + 1) for k in range(len(trace.truths))])
    return Step(t, trace["steer"], trace["yaw_rate"], gain)


def theory(kind: str) -> float | None:
    """Return the theoretical steady yaw rate divided by the steering angle [1/s], or None for MuJoCo's contact
    model."""
    L = TractorParameters().wheelbase_m
    if kind == BICYCLE:
        return SPEED_M_S / (L + paper_gradient(kind) * SPEED_M_S**2)
    if not tyre_of(kind).judged:
        return None
    paper = Tractor(tyre=tyre_of(kind))

    def excess(curvature: float) -> float:
        state = paper.balance(SPEED_M_S**2 * curvature, curvature=curvature)
        return L * curvature + state.front_slip - state.rear_slip - STEER

    return SPEED_M_S * float(brentq(excess, 1e-3, 0.1)) / STEER


def relaxed_bicycle(steer: Array) -> Array:
    """Return the yaw rate at each tick [rad/s] of a bicycle model with relaxation of `linear` tyres and with roll, for
    the steering angles `steer` at each tick [rad]."""
    p, tyre, u, b = TractorParameters(), Linear(), SPEED_M_S, parts(STOCK)
    m, I_z, l_f, l_r = p.mass_kg, p.yaw_inertia_kg_m2, p.cg_to_front_axle, p.cg_to_rear_axle
    C_f, C_r = 2 * tyre.front_cornering_stiffness_n_rad, 2 * tyre.rear_cornering_stiffness_n_rad
    s_f, s_r = (tyre.relaxation_radii * radius for radius in (p.front_wheel_radius_m, p.rear_wheel_radius_m))
    (k_f, k_r), c_r = (
        (wheel.stiffness * p.track_m**2 / 2 for wheel in p.wheels),
        p.rear_wheel.damping * p.track_m**2 / 2,
    )
    s_f += C_f * b.pivot_z**2 / k_f
    h = b.body_z - b.pivot_z * b.body_x / p.wheelbase_m
    G, x = b.body_kg * h, b.body_x - l_r
    # states v, gamma, phi, dphi/dt, and the slips of both axles
    masses = np.array([[m, 0, 0, -G], [0, I_z, 0, -G * x], [0, 0, 1, 0], [-G, -G * x, 0, p.roll_inertia_kg_m2 + G * h]])
    loads = np.array(
        [
            [0, -m * u, 0, 0, -C_f, -C_r],
            [0, 0, 0, 0, -l_f * C_f, l_r * C_r],
            [0, 0, 0, 1, 0, 0],
            [0, G * u, GRAVITY * G - k_r, -c_r, 0, 0],
        ]
    )
    slips = [[1 / s_f, l_f / s_f, 0, 0, -u / s_f, 0], [1 / s_r, -l_r / s_r, 0, 0, 0, -u / s_r]]
    A = np.vstack([np.linalg.solve(masses, loads), slips])
    B = np.array([[0], [0], [0], [0], [-u / s_f], [0]])
    t = TICK_S * np.arange(steer.size)
    _, _, states = lsim((A, B, np.eye(6), np.zeros((6, 1))), steer, t)
    yaw_rate: Array = states[:, 1]
    return yaw_rate


def transient(seen: Step) -> tuple[float, float, float]:
    """Return the measured overshoot, the theoretical overshoot and the RMS difference of yaw rates, divided by the
    steady yaw rate [%]."""
    wanted = relaxed_bicycle(seen.steer)
    steady = wanted[-40:].mean()
    return (
        100 * seen.overshoot,
        float(100 * (wanted.max() / steady - 1)),
        float(100 * np.sqrt(np.mean((seen.yaw_rate - wanted) ** 2)) / steady),
    )


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of steady gain and step response of the bicycle model and all tyres. Quick mode has shorter runs."""
    for subject, plant, truth in m.level_plants():
        m.curves[subject] = seen = step(plant, truth, 6.0 if m.quick else 12.0)
        about, wanted = m.about("steady yaw rate divided by steering angle", subject, "1/s"), theory(subject)
        yield about.reported(seen.gain) if wanted is None else about.near(seen.gain, wanted, BAND)
        yield m.about("response time", subject, "s").reported(seen.response_s)
        about = m.about("overshoot", subject, "%")
        if subject != Linear().kind:
            yield about.reported(100 * seen.overshoot)
            continue
        overshoot, wanted, difference = transient(seen)
        yield about.near(overshoot, wanted, TRANSIENT_BAND)
        about = m.about("deviation of the yaw rate from the bicycle model with relaxation, rms", subject, "%")
        yield about.below(difference, 100 * BAND)

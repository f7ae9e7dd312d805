"""Closed-loop guidance along a side slope

Guided along the contour, the tractor has a steady offset from its line, because its antenna tilts and its wheels are
steered against the slope. Averaged over noise, the steady state of the loop has a closed form. The offset y is positive
to the left of the line, which is uphill. In the table, *held* means that the theory uses the roll, crab and steering
angles of the run. *From parameters* means that the theory uses the slip angles calculated in the section on the side
slope.

Angles are relative to the line. V is the speed, T the tick, L the wheelbase, delta the steady steering angle, beta the
crab angle (heading minus course), phi the roll, and h the height of the antenna. psi^ is the estimated heading. y_R is
the lateral position of R, the point below the centre of the rear axle, and y^_R its estimate. The CG is l_r ahead of R
and h_c above R.

The lateral positions of antenna and CG relative to R are

    a = -h sin(phi) cos(beta),    c = l_r sin(beta) - h_c sin(phi) cos(beta)

The paper's EKF interprets the steady steering angle as a rotation, which the fixes contradict in each tick. In steady
state, its corrections cancel the rotation, with the gains K_y, K_psi of the Riccati equation of (y, psi):

    nu = -T V tan(delta) / (L K_psi),    sin(psi^) = (K_y / K_psi) tan(delta) / L,    y^_R = y_R + a - (1 - K_y) nu

The estimated heading is thus independent of the crab angle, which no sensor measures. The sine of this heading is
tan(delta) / L times the characteristic length K_y / K_psi of the filter, 2.4 m at 1.2 m/s. The estimated lateral
position of the CG is y^ = y^_R + l_r sin(psi^). With terrain compensation, y^_R does not contain a, and the CG is
estimated at y^_R + c(psi^). With a steering bias in the EKF, psi^ = 0 and nu = 0.

The kinematic law has the gain k_e and the saturation k_s. The integral of the speed loop makes the longitudinal error,
after the tanh, equal to tan(psi^) times the lateral error after the tanh. The kinematic law then commands gamma_ref =
-(V sin(psi^) + k_s tanh(k_e y^) / cos(psi^)) / l_r while the tractor does not turn. The PD controller needs this
gamma_ref for the steady steering angle, delta = k_P gamma_ref; a network (or any integral) holds delta with gamma_ref =
0. Hence

    k_s tanh(k_e y^) = -(V sin(psi^) + l_r delta / k_P) cos(psi^)      (with the network: without delta / k_P)

and the true CG is at y = y^ - (y^ - y^_R) - (y^_R - y_R) + c. GNSS and IMU have no noise. Both theories must agree with
the simulation within 1 cm. For *held*, the table shows the larger difference of both directions of travel. *From
parameters* has acceptance limits only in the linear range of the tyres, because a steering angle of 0.1 deg changes the
offset by up to 2.5 cm.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import cycle, product, repeat
from math import atan, atanh, cos, radians, sin, sqrt, tan
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from agrobot_mj.control.kinematic import CascadeLaw
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, force_tyres
from agrobot_mj.extensions.bench.manoeuvres.side_slope import in_linear_range, linear_slip
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor
from agrobot_mj.scenario import Scenario, load_scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run as simulate

GRADES_DEG = (5.0, 10.0, 15.0)
ROOM_CM = 1.0  # Maximum difference between measured and predicted offsets [cm]
DRIVE_S, SETTLED_S = 100.0, 40.0  # Duration of a run, and of its final part that is evaluated [s]
GAINS: dict[str, dict[str, float]] = {
    "pd": {"guidance.gain_per_m": 0.7, "controller.kp": 0.41, "controller.kd": 0.099},
    "pd_t2fnn": {
        "guidance.gain_per_m": 0.37,
        "controller.kp": 0.41,
        "controller.kd": 0.11,
        "controller.network.alpha": 0.062,
    },
}
"""Gains of guidance law and controller, by kind of controller. With `pd`, one degree of steering angle changes the
offset by 5.4 cm."""
ESTIMATORS: dict[str, dict[str, Any]] = {
    "paper's sensors": {},
    "compensated": {"terrain_compensation": True},
    "compensated, ekf_bias": {"kind": "ekf_bias", "terrain_compensation": True},
}


class SlopeState(NamedTuple):
    """Steady state of a tractor on a slope whose left side is uphill."""

    roll: float  # Roll angle phi [rad]
    crab: float  # Crab angle beta: heading relative to the line, positive uphill, seen from above [rad]
    steer: float  # Steering angle delta [rad]


def steady_state(tyre: Any, grade_deg: float) -> SlopeState:
    """Return the theoretical steady state of the tractor across a slope, computed from its parameters only."""
    grade, state = radians(grade_deg), Tractor(tyre=tyre).side_slope(grade_deg)
    crab = atan(tan(state.rear_slip) * cos(grade))
    return SlopeState(grade + state.loads.lean, crab, state.front_slip - state.rear_slip)


def gains(scenario: Scenario) -> tuple[float, float]:
    """Return the steady-state gains K_y [-] and K_psi [rad/m] of the paper's EKF on a straight line."""
    e, T, V = scenario.estimator, TICK_S, scenario.path.speed_m_s
    F = np.array(((1.0, T * V), (0.0, 1.0)))
    Q = T * np.diag(np.square((e.position_walk_m_rt_s, radians(e.yaw_walk_deg_rt_s))))
    R = np.array(((e.gnss_sigma_m**2,),))
    P = solve_discrete_are(F.T, np.eye(2, 1), Q, R)
    return float(P[0, 0] / (P[0, 0] + R[0, 0])), float(P[1, 0] / (P[0, 0] + R[0, 0]))


def steady_estimates(scenario: Scenario, delta: float) -> tuple[float, float]:
    """Return two steady-state estimates of the paper's EKF at a steering angle `delta` [rad]: the sine of the heading
    [-], and the lateral offset of the estimated rear axle from the fixes [m], positive to the left. Both are zero for
    other estimators."""
    if scenario.estimator.kind != "ekf":
        return 0.0, 0.0
    K_y, K_psi = gains(scenario)
    L, V = scenario.tractor.wheelbase_m, scenario.path.speed_m_s
    nu = -TICK_S * V * tan(delta) / (L * K_psi)
    return K_y / K_psi * tan(delta) / L, -(1.0 - K_y) * nu


def offset(scenario: Scenario, slope: SlopeState) -> float:
    """Return the theoretical steady uphill offset of the CG from the line [m]. Raises ValueError if the guidance law
    saturates."""
    s, law, compensated = scenario, scenario.guidance, scenario.estimator.terrain_compensation
    h, l_r, h_c = s.tractor.antenna_height_m, s.tractor.cg_to_rear_axle, s.tractor.cg_height_m
    phi, beta, delta = slope
    sine, ahead = steady_estimates(s, delta)
    cosine = sqrt(1.0 - sine * sine)
    lean = -h * sin(phi) * cos(beta)
    cg = l_r * sin(beta) - h_c * sin(phi) * cos(beta)
    cg_hat = l_r * sine - (h_c * sin(phi) * cosine if compensated else 0.0)
    wanted = l_r * delta / s.controller.kp if s.controller.kind == "pd" else 0.0
    assert isinstance(law, CascadeLaw), law.kind
    y_hat = -atanh((s.path.speed_m_s * sine + wanted) * cosine / law.saturation_m_s) / law.gain_per_m
    if compensated:
        lean += h * sin(phi) * cosine
    return y_hat - cg_hat - ahead - lean + cg


class SlopeDrive(NamedTuple):
    """Steady-state results of a run along a contour line of the slope."""

    scenario: Scenario
    offset: float  # Mean uphill offset of the true CG from the line [m]
    state: SlopeState  # Measured steady state, mirrored if necessary, so that the left side is uphill


def loop(controller: str, estimator: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scenario overrides that select a controller with its `GAINS` and an estimator, and enable the IMU."""
    return {"controller.kind": controller, **GAINS[controller], "estimator": estimator, "sensors.imu.enabled": True}


def drive(
    tyre: Any, grade_deg: float, controller: str, estimator: dict[str, Any], heading_deg: float = 0.0
) -> SlopeDrive:
    """Simulate a run along a contour line and return its steady state. The run is eastwards with the left side uphill
    (`heading_deg` 0), or westwards (180)."""
    given = {
        "duration_s": DRIVE_S,
        "terrain": {"kind": "slope", "grade_deg": grade_deg, "direction_deg": 90.0},
        "path.heading_deg": heading_deg,
        "plant.tyre": {"kind": tyre.kind},
        **loop(controller, estimator),
        "sensors.gnss": {"sigma_m": 0.0, "velocity_sigma_m_s": 0.0},
        "sensors.imu.sigma_deg": 0.0,
        "sensors.imu.wander_sigma_deg": 0.0,
    }
    scenario = load_scenario("straight_line", given)
    return mean_drive(scenario, simulate(scenario), SETTLED_S, 1.0 if heading_deg == 0.0 else -1.0)


NAMES = ("roll", "yaw", "yaw_ref", "steer", "e_lateral")  # Columns of the log that describe a steady state


def mean_drive(scenario: Scenario, log: Log, seconds: float, sign: float = 1.0) -> SlopeDrive:
    """Return the mean state in the last `seconds` [s] of the run of a scenario along a contour line. `sign` is -1 if
    the right side of the tractor is uphill."""
    columns = {name: log.column(name)[-round(seconds / TICK_S) :] for name in NAMES}
    crab = [wrap(yaw) for yaw in columns["yaw"] - columns["yaw_ref"]]
    state = (sign * float(np.mean(values)) for values in (columns["roll"], crab, columns["steer"]))
    return SlopeDrive(scenario, -sign * float(columns["e_lateral"].mean()), SlopeState(*state))


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the offsets with every tyre that has a force law.

    Quick mode tests only the PD controller with the paper's EKF, eastwards on a slope of 10 degrees, and every second
    tyre with terrain compensation.
    """
    grades, ways = ((10.0,), (0.0,)) if m.quick else (GRADES_DEG, (0.0, 180.0))
    chosen: Iterable[tuple[str, str, Any]] = product(("pd", "pd_t2fnn"), ESTIMATORS, force_tyres())
    if m.quick:
        chosen = zip(repeat("pd"), cycle(list(ESTIMATORS)[:2]), force_tyres())
    for controller, words, tyre in chosen:
        for grade in grades:
            seen = [drive(tyre, grade, controller, ESTIMATORS[words], way) for way in ways]
            yield from _against(m, seen, tyre, grade, f"{controller}, {words}, {grade:g} deg")
            m.curves.setdefault(f"{controller}, {words}", {}).setdefault(tyre.kind, []).append((grade, seen[0].offset))


def _against(m: Trial, seen: list[SlopeDrive], tyre: Any, grade_deg: float, words: str) -> Iterator[Check]:
    """Yield checks of the measured offsets `seen` [cm], one per direction of travel, against both theories."""
    pairs = [(100 * run.offset, 100 * offset(run.scenario, run.state)) for run in seen]
    worse = max(pairs, key=lambda pair: abs(pair[0] - pair[1]))
    yield m.about(f"{words}, held", tyre.kind, "cm").close(*worse, ROOM_CM)
    theory = 100 * offset(seen[0].scenario, steady_state(tyre, grade_deg))
    mean = sum(measured for measured, _ in pairs) / len(pairs)
    paper = Tractor(tyre=tyre)
    by_parameters = m.about(f"{words}, from parameters", tyre.kind, "cm").close(mean, theory, ROOM_CM)
    yield by_parameters.judged(in_linear_range(paper, linear_slip(paper, grade_deg)))

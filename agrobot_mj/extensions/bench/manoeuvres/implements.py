"""Tractor with an implement: the third axle

The tractor drives with small steering angles at 1 to 3 m/s, on the `linear` tyre without rolling resistance. A mounted
tool acts as a third axle of stiffness C_t, rigidly attached to the tractor at the distance x_t behind the rear axle R.
The tractor has mass m at the distance l_r ahead of R, and the tool mass m_i at the distance x_i behind R. The
steady-state lateral speed v and yaw rate gamma at R follow from the slip angles of the three axles:

    F_f = C_f (delta - (v + L gamma) / u),   F_r = -C_r v / u,   F_t = -C_t (v - x_t gamma) / u
    F_f + F_r + F_t = (m + m_i) u gamma
    L F_f - x_t F_t = (m l_r - m_i x_i) u gamma

A trailer has its pin at the distance b behind R, and its centre of mass and axle at the distances a and d behind the
pin. The axle carries the lateral force m_i u gamma a / d. The slip angle of the trailer axle at this force determines
the angle between trailer and tractor. The pin carries the rest of the lateral force: the tractor turns as with a point
mass m_i (1 - a / d) at the pin. At walking pace the motion is purely geometric. The trailer axle then has the turning
radius sqrt(R^2 + b^2 - d^2), where R is the turning radius of the rear axle.

The draught follows ASABE D497 at the current speed and depth. At constant speed, the pull at the hitch is the sum of
all resistances of the implement.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.machine.implements import Drawn, ImplementBase, Mounted, Tool
from agrobot_mj.machine.implements.draught import TOOLS
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.driver import STOCK, Driver
from agrobot_mj.plants.mujoco.implement import COLUMNS
from agrobot_mj.tyres import Linear, MagicFormula

SPEEDS_M_S = (1.0, 2.0, 3.0)
STEER = 0.02  # Small steering angle [rad], for which the equations are linear
SHARP = 0.25  # Steering angle for the slow circle [rad]
BAND = 0.02
TYRE = Linear()
AXLES = 2 * TYRE.front_cornering_stiffness_n_rad, 2 * TYRE.rear_cornering_stiffness_n_rad
"""Cornering stiffnesses of the front axle and of the rear axle [N/rad]."""
PLOUGH = Mounted(
    tool=Tool(draught_scale=0.0, noise_share=0.0, cornering_stiffness_n_deg=200.0, side_limit_n=1e5), mass_kg=110.0
)
"""Mounted tool with lateral forces and without draught."""
TRAILER = Drawn(cg_height_m=0.5)
CHISEL = Tool(type="chisel_plough", size=3.0, depth_m=0.1, texture="fine", noise_share=0.0, suction_share=0.0)


class Steady(NamedTuple):
    """Steady-state response of the tractor and implement to steering."""

    gain: float  # Yaw rate divided by steering angle [1/s]
    hitch: float  # Hitch angle divided by steering angle [-]


def three_axles(tractor: TractorParameters, plough: Mounted, u: float) -> Steady:
    """Return the theoretical steering response of a tractor with a rigidly mounted tool, at the speed `u` [m/s]."""
    (C_f, C_r), L = AXLES, tractor.wheelbase_m
    C_t = plough.tool.cornering_stiffness_n_deg * 180 / np.pi
    x_t, x_i = tractor.hitch_behind_m + plough.tool_behind_m, tractor.hitch_behind_m + plough.cg_behind_m
    m, m_i = tractor.mass_kg, plough.mass_kg
    # unknowns: v and gamma for a unit steering angle
    forces = [(C_f + C_r + C_t) / u, (C_f * L - C_t * x_t) / u + (m + m_i) * u]
    moments = [
        (C_f * L - C_t * x_t) / u,
        (C_f * L * L + C_t * x_t * x_t) / u + (m * tractor.cg_to_rear_axle - m_i * x_i) * u,
    ]
    _, gamma = np.linalg.solve([forces, moments], [C_f, C_f * L])
    return Steady(float(gamma), 0.0)


def with_trailer(tractor: TractorParameters, trailer: Drawn, u: float) -> Steady:
    """Return the theoretical steering response of a tractor with a trailer, at the speed `u` [m/s]."""
    (C_f, C_r), L, b = AXLES, tractor.wheelbase_m, tractor.hitch_behind_m
    C_i = C_r * trailer.slip_stiffness_scale
    share = trailer.cg_behind_m / trailer.axle_behind_m
    pin = trailer.mass_kg * (1 - share)
    front = (tractor.mass_kg * tractor.cg_to_rear_axle - pin * b) / L
    rear = tractor.mass_kg + pin - front
    gamma = u / (L + (front / C_f - rear / C_r) * u * u)
    v = -rear * u * gamma * u / C_r
    slip = trailer.mass_kg * share * u * gamma / C_i
    return Steady(gamma, (v - (b + trailer.axle_behind_m) * gamma) / u + slip)


class Hauler:
    """Tractor with an implement, controlled by feedback of the true state."""

    def __init__(self, m: Trial, implement: ImplementBase, tyre: Any = TYRE) -> None:
        self.driver = Driver(*m.mujoco(tyre, machine=STOCK._replace(implement=implement)))

    def drive(self, speed: float, seconds: float, steer: float) -> dict[str, Array]:
        """Simulate `seconds` [s]. Return signals of the tractor and implement in the last second, shape (20,) each."""
        self.driver.speed = speed
        self.driver.go(seconds - 1.0, steer)
        rows, reported = [], [column.name for column in COLUMNS]
        for _ in range(20):
            truth = self.driver.go(0.05, steer).truths[-1]
            rows.append(truth._asdict() | dict(zip(reported, self.driver.plant.report(), strict=True)))
        names = [name for name, value in rows[0].items() if isinstance(value, float)]
        return {name: np.array([row[name] for row in rows]) for name in names}


def turns(m: Trial, implement: ImplementBase, theory: Any, words: str, seconds: float) -> Iterator[Check]:
    """Yield checks that compare yaw-rate gain and hitch angle with theory, at several speeds."""
    hauler = Hauler(m, implement)
    for speed in SPEEDS_M_S:
        found = hauler.drive(speed, seconds, STEER)
        steer, wanted = found["steer"].mean(), theory(STOCK.tractor, implement, found["speed"].mean())
        about = m.about(f"{words}, yaw gain at {speed:g} m/s", TYRE.kind, "1/s")
        yield about.near(float(found["yaw_rate"].mean() / steer), wanted.gain, BAND)
        if wanted.hitch:
            about = m.about(f"{words}, angle at the pin divided by steering angle at {speed:g} m/s", TYRE.kind, "-")
            yield about.near(float(found["hitch_angle"].mean() / steer), wanted.hitch, BAND)


def radius_of(truth: dict[str, Array], x: str, y: str) -> float:
    """Return the mean distance of a point from the tractor's instantaneous centre of rotation [m]. `x` and `y` are the
    names of the signals with the coordinates of the point."""
    R = truth["speed"] / truth["yaw_rate"]
    c_x, c_y = truth["rear_x"] - R * np.sin(truth["yaw"]), truth["rear_y"] + R * np.cos(truth["yaw"])
    return float(np.hypot(truth[x] - c_x, truth[y] - c_y).mean())


def off_tracking(m: Trial, seconds: float) -> Check:
    """Return a check of the radius of the trailer axle on a slow circle."""
    b, d = STOCK.tractor.hitch_behind_m, TRAILER.axle_behind_m
    found = Hauler(m, TRAILER).drive(0.5, seconds, SHARP)
    wanted = (radius_of(found, "rear_x", "rear_y") ** 2 + b * b - d * d) ** 0.5
    about = m.about(f"trailer, radius of its axle at {SHARP:g} rad and 0.5 m/s", TYRE.kind, "m")
    return about.near(radius_of(found, "implement_x", "implement_y"), wanted, BAND)


def pulls(m: Trial, seconds: float) -> Iterator[Check]:
    """Yield checks that compare the draught with the formula of the standard, and the pull with the sum of
    resistances."""
    tyre, row = MagicFormula(), TOOLS[CHISEL.type]
    hauler = Hauler(m, Drawn(lowered=True, tool=CHISEL), tyre)
    for speed in SPEEDS_M_S[:2]:
        found = hauler.drive(speed, seconds, 0.0)
        S, T = 3.6 * float(found["speed"].mean()), 100 * float(found["tool_depth"].mean())
        D = row.textures[0] * (row.a + row.b * S + row.c * S * S) * CHISEL.size * T
        about = m.about(f"draught of a chisel plough at {speed:g} m/s", tyre.kind, "N")
        yield about.near(float(found["draught"].mean()), D, BAND)
        rolling = tyre.rolling_resistance * float((found["load_il"] + found["load_ir"]).mean())
        about = m.about(f"pull at the hitch at {speed:g} m/s", tyre.kind, "N")
        yield about.near(float(found["hitch_pull"].mean()), D + rolling, BAND)


def run(m: Trial) -> Iterator[Check]:
    """Yield all checks of implements. Runs are shorter in quick mode."""
    seconds = 14.0 if m.quick else 25.0
    yield from turns(m, PLOUGH, three_axles, "mounted tool", seconds)
    yield from turns(m, TRAILER, with_trailer, "trailer", seconds)
    yield off_tracking(m, 25.0 if m.quick else 60.0)
    yield from pulls(m, seconds)

"""Sliding and spinning wheels: force against the sliding direction, inside the ellipse, and dissipative."""

from itertools import product
from math import atan2, cos, degrees, exp, hypot, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from turns import by_turns

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.kernels import jit
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.scenario.schema import resolve
from agrobot_mj.terrain import Flat
from agrobot_mj.tyres import MagicFormula, Ruts, Soil
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import tyre_set, wheel_step, with_soil_memory
from agrobot_mj.tyres.magic_formula import NO_PEAK, Curve
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, FRICTION_USE, SLIP_RATIO, WheelMotion
from agrobot_mj.tyres.patch import LOAD as CARRIED

TRACTOR, GROUND, DT = TractorParameters(), Flat().ground(), 0.002
GRIPPING = {
    "magic_formula": MagicFormula(),
    "soil": Soil(),
    "tilled": Soil(cone_index_kpa=450),
    "radial": Soil(cone_index_kpa=700, ply="radial"),
    "ruts": Ruts(),
}
FRONT, REAR = 0, 2
LOAD = {FRONT: 1400.0, REAR: 2300.0}
SPEEDS = (0.05, 0.3, 1.0, 4.0)


@jit
def hold(tyres, i, ground, motion, steps, bristle, wrench, report):
    """Evaluate a number of steps at a constant motion."""
    for _ in range(steps):
        wheel_step(tyres, i, ground, motion, DT, bristle, wrench, report)


class Wheel:
    """Wheel at its static load and a constant motion."""

    def __init__(self, tyre, i=REAR, grip=1.0):
        self.tyres, self.i = tyre_set(tyre, TRACTOR), i
        self.ground = with_soil_memory(GROUND, self.tyres.bearing)
        self.tyres.grip[:] = grip
        self.sunk = LOAD[i] / self.tyres.stiffness[i]
        self.radius, self.r_e = self.tyres.radius[i], self.tyres.radius[i] - self.sunk / 3
        self.bristle, self.wrench, self.report = np.zeros(4), np.zeros(6), np.zeros(6)

    def step(self, v_x, v_y, rim, steps=1):
        """Return the report after a number of steps at hub velocities forward and left and at a rim velocity [m/s]."""
        motion = WheelMotion(
            (0.0, 0.0, self.radius - self.sunk), (0.0, 1.0, 0.0), (v_x, v_y, 0.0), (0.0, rim / self.r_e, 0.0)
        )
        hold(self.tyres, self.i, self.ground, motion, steps, self.bristle, self.wrench, self.report)
        return self.report

    def steady(self, v_x, v_y, rim):
        """Return the report after rolling for thirty radii or sliding for a metre, whichever takes more steps."""
        rolling, sliding = max(abs(v_x), abs(rim) / 2, 1e-9), hypot(v_x - rim, v_y)
        time_s = 30 * self.radius / rolling if rolling > 0.1 * sliding else 1.0 / max(sliding, 1e-3)
        return self.step(v_x, v_y, rim, min(round(time_s / DT), 60_000))


def lean(report, v_x, v_y, rim):
    """Return the angle between the force and the direction opposite to the sliding velocity [deg]."""
    turn = atan2(report[FORCE_Y], report[FORCE_X]) - atan2(-v_y, rim - v_x)
    return abs(degrees((turn + pi) % (2 * pi) - pi))


def slides(v_x, v_y, rim):
    """Return the combined slip: sliding speed divided by the maximum of hub and rim speed [-]."""
    return hypot(v_x - rim, v_y) / max(hypot(v_x, v_y), abs(rim))


@pytest.mark.parametrize(
    ("tyre", "speed"), by_turns([pytest.param(tyre, id=name) for name, tyre in GRIPPING.items()], SPEEDS)
)
def test_force_opposes_the_sliding_direction_above_80_percent_slip(tyre, speed):
    """Cases are locked, strongly braked and spinning wheels, at every angle to the heading."""
    judged = 0
    for i, angle_deg, s in product((FRONT, REAR), (5, 45, 70, 80, 88), (-1.0, -0.9, -0.8, 0.8, 0.9, 0.97)):
        v_x, v_y = speed * cos(radians(angle_deg)), speed * sin(radians(angle_deg))
        rim = v_x / (1 - s) if s > 0 else v_x * (1 + s)
        if slides(v_x, v_y, rim) < 0.8:
            continue
        assert lean(Wheel(tyre, i).steady(v_x, v_y, rim), v_x, v_y, rim) < 5.0, (i, angle_deg, s)
        judged += 1
    assert judged > 40


@pytest.mark.parametrize("tyre", GRIPPING.values(), ids=list(GRIPPING))
@pytest.mark.parametrize(
    ("v_x", "v_y", "rim"),
    [(0.0, 0.0, 4.0), (0.0, 0.1, 4.0), (0.0, 0.5, 0.0), (-1.0, 0.4, -8.0), (-1.0, -2.0, 0.0), (1.0, 0.2, -1.0)],
    ids=["on the spot", "drifting", "broadside", "in reverse", "locked in reverse", "plugging"],
)
def test_force_on_a_spinning_or_sideways_dragged_wheel_opposes_sliding(tyre, v_x, v_y, rim):
    wheel = Wheel(tyre)
    report = wheel.steady(v_x, v_y, rim)
    assert lean(report, v_x, v_y, rim) < 5.0
    assert hypot(report[FORCE_X], report[FORCE_Y]) > 0.5 * report[CARRIED] > 0.1 * LOAD[REAR]  # on ruts it digs in


def test_force_on_a_locked_wheel_opposes_sliding_on_slippery_ground():
    for tyre, grip in product(GRIPPING.values(), (0.1, 0.5)):
        v_x, v_y = cos(radians(60)), sin(radians(60))
        firm, slippery = (Wheel(tyre, grip=g).steady(v_x, v_y, 0.0).copy() for g in (1.0, grip))
        if isinstance(tyre, MagicFormula):  # soil also resists rolling, whatever its grip
            assert lean(slippery, v_x, v_y, 0.0) < 5.0
        # at a fixed height, the load depends on the soil cells below the displaced tread
        used, full = (report[FORCE_Y] / report[CARRIED] for report in (slippery, firm))
        assert used == pytest.approx(grip * full, rel=0.05)


def brixius(cone_index, s, W=LOAD[REAR], b=0.24, d=0.84, k=TRACTOR.rear_wheel.stiffness):
    """Return net traction divided by load of the rear bias-ply tyre [-], with the tyre's own loss as a moment."""
    h = 0.75 * b
    B_n = (cone_index * b * d / W) * (1 + 5 * W / k / h) / (1 + 3 * b / d)
    return 0.88 * (1 - exp(-0.1 * B_n)) * (1 - exp(-7.5 * s)) - 1 / B_n - 0.5 * s / sqrt(B_n)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("cone_index_kpa", [300, 450, 1200, 2000])
def test_traction_follows_brixius_up_to_95_percent_slip(cone_index_kpa, way):
    wheel = Wheel(Soil(cone_index_kpa=cone_index_kpa))
    for s, speed in product((0.02, 0.1, 0.3, 0.5, 0.55, 0.7, 0.83, 0.9, 0.95), (0.2, 1.0)):
        pull = way * wheel.steady(way * speed, 0.0, way * speed / (1 - s))[FORCE_X] / LOAD[REAR]
        assert pull == pytest.approx(brixius(1e3 * cone_index_kpa, s), abs=1e-4)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("kappa", [-1.0, -0.4, 0.5, 1.0, 3.0, 9.0])
def test_reported_slip_ratio_is_correct_and_positive_when_driving(kappa, way):
    found = Wheel(MagicFormula()).steady(way * 1.0, 0.0, way * (1.0 + kappa))
    assert found[SLIP_RATIO] == pytest.approx(kappa, rel=2e-3)
    assert found[FORCE_X] * way * kappa > 0


@pytest.mark.parametrize("way", [1, -1])
def test_reported_slip_ratio_is_finite_when_spinning_and_zero_at_rest(way):
    assert Wheel(Soil()).steady(0.0, 0.0, way * 4.0)[SLIP_RATIO] == pytest.approx(20.0, rel=0.01)
    assert Wheel(Soil()).step(0.0, 0.0, 0.0, 100)[SLIP_RATIO] == 0.0


motions = st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-6, 6))


@pytest.mark.parametrize("tyre", GRIPPING.values(), ids=list(GRIPPING))
@settings(deadline=None, max_examples=60)
@given(motion=motions, scale=st.sampled_from([1.0, 0.01, 1e-6]))
def test_tyre_force_is_finite_dissipative_and_inside_the_ellipse(tyre, motion, scale):
    """The kernel computes the forces. Power includes force and torque, after the bristles have settled."""
    v_x, v_y, rim = (scale * v for v in motion)
    wheel = Wheel(tyre)
    used = [wheel.step(v_x, v_y, rim)[FRICTION_USE] for _ in range(20)]
    report = wheel.steady(v_x, v_y, rim)
    assert np.isfinite(report).all()
    assert np.isfinite(wheel.wrench).all()
    assert max(*used, report[FRICTION_USE]) <= 1.0 + 1e-9
    power = wheel.wrench[:3] @ (v_x, v_y, 0.0) + wheel.wrench[4] * rim / wheel.r_e
    assert power <= 1e-9 * LOAD[REAR] * (hypot(v_x, v_y) + abs(rim))


@settings(deadline=None)
@example(shape=1.3, curvature=1.0)  # no peak: the force increases with slip
@given(shape=st.floats(1.001, 1.9), curvature=st.floats(-10, 1))
def test_peak_of_the_magic_formula_is_its_maximum(shape, curvature):
    curve = Curve(shape=shape, curvature=curvature)
    b = curve.peak / shape * np.array([0.99, 1.0, 1.01])
    force = np.sin(shape * np.arctan(b - curvature * (b - np.arctan(b))))
    assert force[1] >= force[0]
    assert force[1] >= force[2] or b[1] == NO_PEAK


@settings(deadline=None, max_examples=200)
@example(x=0.0, y=9.6e-12, grip=0.0625, a=0.0, travel=1.0)
@example(x=-3e-13, y=0.0, grip=0.05, a=1.0, travel=1.0)
@given(x=st.floats(-2, 2), y=st.floats(-6, 6), grip=st.floats(0.05, 2), a=st.floats(0, 1), travel=st.floats(-1, 1))
def test_tyre_force_is_dissipative_and_in_the_ellipse_for_any_anisotropy(x, y, grip, a, travel):
    for tyre in (MagicFormula(sliding_anisotropy=a), Soil(sliding_anisotropy=a)):
        _, law = tyre.coefficients(TRACTOR)
        F = law.force(Slip(x, y, LOAD[REAR], 0.0144, 1.0, Footing(grip, 1.2e6), travel))
        peaks = [
            law.force(Slip(*pure, LOAD[REAR], 0.0144, 1e9, Footing(grip, 1.2e6), 1.0))
            for pure in ((-1.0, 0.0), (0.0, -1e6))
        ]
        D_x = peaks[0].x / peaks[0].used
        D_y = peaks[1].y / peaks[1].used
        assert hypot(F.x / D_x, F.y / D_y) <= 1 + 1e-9
        assert F.x * x + F.y * y <= 0.0
        assert hypot(F.x / D_x, F.y / D_y) == pytest.approx(F.used, abs=1e-9)


def test_anisotropy_rotates_sliding_force_towards_the_axis_of_more_grip():
    """On soil, the longitudinal grip is larger. At anisotropy 1, the sliding direction is the normal of the ellipse."""
    angle = radians(45)
    leans = []
    for a in (0.0, 0.5, 1.0):
        _, law = Soil(sliding_anisotropy=a).coefficients(TRACTOR)
        F = law.force(Slip(cos(angle), sin(angle), LOAD[REAR], 0.0144, 0.5, Footing(1.0, 1.2e6), 1.0))
        leans.append(degrees(atan2(-F.y, -F.x)))
    D_x, D_y = 0.88, 0.61 + 0.69 / 26.1
    assert leans[0] == pytest.approx(45.0, abs=0.01)
    assert leans[0] > leans[1] > leans[2]
    assert leans[2] == pytest.approx(degrees(atan2(D_y**2, D_x**2)), abs=0.5)


@pytest.mark.parametrize("ply", ["bias", "radial"])
def test_side_force_on_soil_vanishes_with_the_soil_strength(ply):
    """The lateral fit alone would grow without limit as traction vanishes."""
    peaks = []
    for cone_index_kpa in (50, 80, 120, 200, 400):
        tyre = Soil(cone_index_kpa=cone_index_kpa, ply=ply)
        peaks.append(-Wheel(tyre, FRONT).steady(1.0, 20.0, 1.0)[FORCE_Y] / LOAD[FRONT])
    assert max(peaks) < 0.9
    assert np.array(peaks[:3]) / peaks[2] == pytest.approx([50 / 120, 80 / 120, 1.0], rel=0.01)


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ({"plant": {"kind": "mujoco", "tyre": {"kind": "soil", "cone_index_kpa": 40}}}, "plant.tyre.cone_index_kpa"),
        ({"terrain": {"patch": [{"kind": "circle", "cone_index_kpa": 40}]}}, r"terrain.patch\[0\].cone_index_kpa"),
    ],
)
def test_error_for_soil_outside_the_fitted_range_names_key_and_limit(table, key):
    with pytest.raises(ScenarioError, match=key + r".*from 50 to 5000 kPa.*got 40"):
        resolve(table, "field.toml")

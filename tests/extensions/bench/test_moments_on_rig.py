"""Tyre moments about the vertical: aligning moment while rolling, and scrubbing moment while turning."""

from math import radians, sqrt, tan

import numpy as np
import pytest
from wheel_steps import step_of

from agrobot_mj.extensions.bench.rig import FRONT, Rig, Setting
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.terrain.grid import Surface
from agrobot_mj.tyres import Linear, MagicFormula, Ruts, Soil
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import FORCE_Y, WheelMotion

TRACTOR, GROUND, DT = TractorParameters(), Flat().ground(), 0.002
SCRUBBING = [MagicFormula(), Soil()]
GRIP = 0.75  # Friction under a scrubbing patch, as the tyres have it
SUNK = TRACTOR.front_wheel.deflection
HALF_M = sqrt(2 * 0.28 * SUNK)  # Half the chord that the static deflection of the front tyre cuts off [m]
MOST = GRIP * TRACTOR.front_wheel.load * 0.16 / sqrt(8)
"""Moment that turns a patch of 0.16 m width at standstill, by a rule of manufacturers of steering units [N m]."""


class Turning:
    """Front wheel that turns about the vertical at a constant load."""

    def __init__(self, tyre):
        self.tyres = tyre_set(tyre, TRACTOR)
        self.advance = step_of(self.tyres, GROUND)
        self.bristle, self.wrench, self.report = np.zeros(4), np.zeros(6), np.zeros(6)

    def moments(self, turns, v=0.0):
        """Return the moment about the vertical after each step, for turn rates `turns` [rad/s] and speed `v` [m/s]."""
        return np.array([self.step(turn, v) for turn in turns])

    def step(self, turn, v):
        centre, axle = (0.0, 0.0, 0.28 - SUNK), (0.0, 1.0, 0.0)
        rotation = (0.0, v / (0.28 - SUNK / 3), turn)
        motion = WheelMotion(centre, axle, (v, 0.0, 0.0), rotation)
        self.advance(self.tyres, 0, GROUND, motion, DT, self.bristle, self.wrench, self.report)
        return float(self.wrench[5])


def yawed(tyre, v, slip):
    """Return the steady moment of a wheel that rolls at `v` [m/s] and slides to the left by the tangent `slip`."""
    wheel = Turning(tyre)
    velocity = (v, v * slip if v > 0 else -v * slip, 0.0)
    motion = ((0.0, 0.0, 0.28 - SUNK), (0.0, 1.0, 0.0), velocity, (0.0, v / (0.28 - SUNK / 3), 0.0))
    for _ in range(3000):
        wheel.advance(wheel.tyres, 0, GROUND, WheelMotion(*motion), DT, wheel.bristle, wheel.wrench, wheel.report)
    return float(wheel.wrench[5])


@pytest.mark.parametrize("slip", [-0.3, -0.05, 0.01, 0.1])
def test_aligning_moment_turns_a_wheel_towards_its_velocity(slip):
    tyre = MagicFormula()
    assert yawed(tyre, 1.0, slip) * slip > 0
    assert yawed(tyre, -1.0, slip) * slip < 0
    assert yawed(tyre, 1.0, slip) == pytest.approx(-yawed(tyre, 1.0, -slip))


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("slip", [-0.2, 0.03])
def test_only_the_aligning_moment_acts_on_a_wheel_rolling_straight(way, slip):
    """The aligning moment is the side force times the trail, which is behind the patch in the direction of travel."""
    wheel, trail = Turning(MagicFormula(trail_m=0.03)), 0.03
    velocity, rotation = (float(way), slip, 0.0), (0.0, way / (0.28 - SUNK / 3), 0.0)
    motion = WheelMotion((0.0, 0.0, 0.28 - SUNK), (0.0, 1.0, 0.0), velocity, rotation)
    for _ in range(100):
        wheel.advance(wheel.tyres, 0, GROUND, motion, 0.1, wheel.bristle, wheel.wrench, wheel.report)
    behind = way * trail * np.exp(-abs(slip) / 0.1)
    assert wheel.wrench[5] == pytest.approx(-behind * wheel.report[FORCE_Y], rel=1e-3)
    assert wheel.wrench[5] * slip * way > 0


def test_aligning_moment_arm_equals_the_trail_only_at_small_slip():
    rig = Rig(MagicFormula(trail_m=0.04), TRACTOR)
    levers = []
    for angle in (0.01, 2.0, 6.0, 15.0, 40.0):
        reading = rig.steady(Setting(1.0, radians(angle), 0.0, 1400.0))
        levers.append(-reading.mz / reading.fy)
        assert levers[-1] == pytest.approx(0.04 * np.exp(-tan(radians(angle)) / 0.1), rel=1e-6)
    assert (np.diff(levers) < 0).all()
    assert levers[0] == pytest.approx(0.04, rel=0.01)


def test_aligning_moment_is_zero_without_a_trail():
    for tyre in (MagicFormula(trail_m=0.0, load_follows_carcass=False), Soil(load_follows_carcass=False), Linear()):
        assert Rig(tyre, TRACTOR).steady(Setting(1.0, 0.1, 0.05, 1400.0)).mz == pytest.approx(0.0, abs=1e-9)


def test_drive_force_at_the_displaced_patch_turns_the_wheel():
    """The lever arm of the drive force is the side force divided by the lateral stiffness of the carcass."""
    reading = Rig(MagicFormula(trail_m=0.0), TRACTOR).steady(Setting(1.0, 0.1, 0.05, 1400.0))
    arm = reading.fy / (0.45 * TRACTOR.front_wheel.stiffness)
    assert abs(arm) > 0.01
    assert reading.mz == pytest.approx(-arm * reading.fx, rel=1e-6)


@pytest.mark.parametrize("tyre", SCRUBBING, ids=lambda tyre: tyre.kind)
@pytest.mark.parametrize("turn", [-1.0, -0.2, 0.2, 1.0])
def test_scrubbing_moment_opposes_steering_at_standstill_and_is_limited(tyre, turn):
    wheel = Turning(tyre)
    moments = wheel.moments([turn] * 1000)
    assert (moments * turn < 0).all()
    assert abs(moments[-1]) == pytest.approx(MOST)
    assert np.abs(moments).max() <= MOST * (1 + 1e-9)
    assert (np.diff(np.abs(moments)) >= -1e-9).all()


@pytest.mark.parametrize("tyre", SCRUBBING, ids=lambda tyre: tyre.kind)
def test_scrubbing_moment_is_proportional_to_friction(tyre):
    dry, wet = Turning(tyre), Turning(tyre)
    wet.tyres.grip[:] = 0.5
    assert wet.moments([1.0] * 1000)[-1] == pytest.approx(0.5 * dry.moments([1.0] * 1000)[-1])
    icy = Turning(tyre)
    surface = Surface(-100.0, -100.0, 200.0, np.full((1, 1), 0.25), np.zeros((1, 1)))
    motion = WheelMotion((0.0, 0.0, 0.28 - SUNK), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    for _ in range(1000):
        icy.advance(icy.tyres, 0, GROUND._replace(surface=surface), motion, DT, icy.bristle, icy.wrench, icy.report)
    assert icy.wrench[5] == pytest.approx(0.25 * dry.wrench[5])


@pytest.mark.parametrize("tyre", SCRUBBING, ids=lambda tyre: tyre.kind)
def test_stationary_wheel_keeps_its_torsional_deflection(tyre):
    wheel = Turning(tyre)
    twisted = wheel.moments([0.5] * 50)[-1]
    assert twisted < 0
    assert wheel.moments([0.0] * 500) == pytest.approx(twisted)


@pytest.mark.parametrize("tyre", SCRUBBING, ids=lambda tyre: tyre.kind)
def test_tyre_torsion_decays_within_a_fraction_of_the_patch_length(tyre):
    wheel, v = Turning(tyre), 1.0
    twisted = wheel.moments([0.5] * 50)[-1]
    length = HALF_M * 0.16**2 / (4 * HALF_M**2 + 0.16**2)
    rolled = wheel.moments([0.0] * round(3 * length / v / DT), v)
    travelled = v * DT * np.arange(1, len(rolled) + 1)
    assert rolled == pytest.approx(twisted * np.exp(-travelled / length))


@pytest.mark.parametrize("tyre", SCRUBBING, ids=lambda tyre: tyre.kind)
@pytest.mark.parametrize("v", [0.0, 0.3, -0.3])
def test_scrubbing_back_and_forth_dissipates_energy(tyre, v):
    t = DT * np.arange(5000)
    turns = 0.6 * np.sin(2 * np.pi * 0.5 * t)
    wheel = Turning(tyre)
    moments = wheel.moments(turns, v)
    work = DT * np.cumsum(moments * turns)
    stored = 0.5 * MOST**2 / wheel.tyres.twist_stiffness[0]
    assert work[-1] < -2 * stored
    assert work.max() <= 1e-9
    assert (work[1000:] - work[:-1000] < 0).all()  # over each whole period


def test_contact_patch_without_length_has_no_scrubbing_moment():
    for tyre in (MagicFormula(patch_half_length_m=0.0), Soil(patch_half_length_m=0.0), Linear()):
        assert not Turning(tyre).moments([1.0] * 10).any()


def test_parked_wheel_is_harder_to_steer_than_a_rolling_wheel():
    slow = [0.2] * 400
    still = abs(Turning(MagicFormula()).moments(slow)[-1])
    rolling = abs(Turning(MagicFormula()).moments(slow, 1.0)[-1])
    assert rolling < 0.4 * still


def test_airborne_wheel_has_no_aligning_or_scrubbing_moment():
    wheel = Turning(MagicFormula())
    wheel.moments([1.0] * 50)
    motion = ((0.0, 0.0, 0.3), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    wheel.advance(wheel.tyres, FRONT, GROUND, WheelMotion(*motion), DT, wheel.bristle, wheel.wrench, wheel.report)
    assert not wheel.wrench.any()
    assert not wheel.bristle.any()


@pytest.mark.parametrize("tyre", [MagicFormula(), Soil(), Ruts()], ids=lambda tyre: tyre.kind)
def test_contact_patch_length_is_the_chord_at_static_deflection(tyre):
    large = TRACTOR.model_copy(
        update={
            "mass_kg": 5200.0,
            "rear_wheel_radius_m": 0.8,
            "front_tyre_stiffness_n_m": 3e5,
            "front_wheel_radius_m": 0.5,
        }
    )
    front, rear = tyre_set(tyre, large).patch_half_length[[0, 2]]
    assert front == pytest.approx(sqrt(2 * 0.5 * (5200 * 9.81 * 0.38 / 2) / 3e5))
    assert rear == pytest.approx(sqrt(2 * 0.8 * (5200 * 9.81 * 0.62 / 2) / large.rear_wheel.stiffness))
    given = tyre.model_copy(update={"patch_half_length_m": 0.05})
    assert tyre_set(given, large).patch_half_length.tolist() == [0.05] * 4

"""Furrows and bumps: heights of the grid, and motion of wheels that roll over them."""

from itertools import product

import mujoco
import numpy as np
import pytest
from scipy.signal import find_peaks
from turns import by_turns
from tyre_laws import force_tyres

from agrobot_mj.core.signals import NEUTRAL_V, Drive
from agrobot_mj.plants.driver import ORIGIN, Driver, mujoco_plant
from agrobot_mj.terrain import Bumps, Ridges, Rough, height_and_gradient
from agrobot_mj.tyres import MagicFormula

DT = 0.002


def height(ground, x, y):
    return height_and_gradient(ground, x, y)[0]


def line(ground, direction_deg, length=12.0, step=0.01):
    """Return distances and heights along a line through the origin."""
    s = np.arange(-length / 2, length / 2, step)
    c, d = np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))
    return s, np.array([height(ground, c * a, d * a) for a in s])


@pytest.mark.parametrize("profile", ["sine", "flat"])
@pytest.mark.parametrize("furrows_deg", [90.0, 0.0, 37.0])
def test_furrows_have_the_configured_depth_spacing_and_direction(profile, furrows_deg):
    ground = Ridges(
        depth_m=0.16, spacing_m=0.8, furrow_direction_deg=furrows_deg, profile=profile, half_size_m=9.0, node_m=0.04
    ).ground()
    s, across = line(ground, furrows_deg - 90.0)
    assert np.ptp(across) == pytest.approx(0.16, rel=0.02)
    middle = (across > 0)[1:] & (across <= 0)[:-1]
    assert np.diff(s[1:][middle]) == pytest.approx(0.8, abs=0.02)
    assert across[np.argmin(np.abs(s))] == pytest.approx(0.08, rel=0.02)
    _, along = line(ground, furrows_deg)
    assert np.ptp(along) < 0.16 * 0.03
    level = np.mean(np.abs(across) > 0.95 * 0.08)
    assert level > 0.6 if profile == "flat" else level < 0.3


def test_furrow_crest_offset_can_be_configured():
    ground = Ridges(furrow_direction_deg=90.0, spacing_m=0.8, offset_m=0.2, node_m=0.05, half_size_m=5.0).ground()
    assert height(ground, 0.2, 3.0) == pytest.approx(0.05, rel=1e-3)
    assert height(ground, -0.2, 3.0) == pytest.approx(-0.05, rel=1e-3)


def wheel_heights(terrain, seconds, speed=0.4, tyre=MagicFormula()):
    """Return positions along the path and the heights of the four wheel centres on a straight path to the east."""
    plant, truth = mujoco_plant(tyre, terrain)
    driver, seen = Driver(plant, truth, speed), []
    for _ in range(round(seconds / 0.05)):
        driver.go(0.05)
        seen.append(plant.data.xpos[plant.views.wheels].copy())
    assert plant.trouble() is None
    return np.array(seen)


def test_wheels_crossing_furrows_move_with_furrow_depth_and_spacing():
    depth, spacing = 0.08, 2.2
    seen = wheel_heights(Ridges(depth_m=depth, spacing_m=spacing, half_size_m=20.0, node_m=0.1), 25.0)
    for wheel in range(4):
        x, z = seen[40:, wheel, 0], seen[40:, wheel, 2]
        crests, troughs = find_peaks(z, prominence=depth / 2)[0], find_peaks(-z, prominence=depth / 2)[0]
        assert len(crests) >= 3
        assert np.diff(x[crests]) == pytest.approx(spacing, rel=0.05)
        assert z[crests].mean() - z[troughs].mean() == pytest.approx(depth, rel=0.05)


def test_row_of_bumps_is_at_the_configured_position():
    ground = Bumps(
        height_m=0.12, x_m=2.0, y_m=-0.5, spacing_m=2.5, count=3, stagger_m=1.0, node_m=0.05, half_size_m=10.0
    ).ground()
    for x, y in ((2.0, -0.5), (4.5, 0.5), (7.0, -0.5)):
        assert height(ground, x, y) == pytest.approx(0.12, rel=1e-6)
        assert height(ground, x + 0.25, y) == pytest.approx(0.06, rel=0.02)
        assert height(ground, x, y + 0.2) == pytest.approx(0.06, rel=0.02)
        assert height(ground, x + 0.51, y) < 1e-12
        assert height(ground, x, y + 0.41) < 1e-12
    assert (ground.heights > 1e-3).sum() * 0.05**2 == pytest.approx(3 * 1.0 * 0.8, rel=0.2)


def test_row_of_bumps_is_aligned_with_its_heading():
    ground = Bumps(
        heading_deg=90.0, x_m=1.0, y_m=0.0, length_m=3.0, width_m=0.6, count=1, node_m=0.05, half_size_m=10.0
    ).ground()
    assert height(ground, 1.0, 1.2) > 0.0
    assert height(ground, 2.2, 0.0) < 1e-12


def test_pits_are_inverted_bumps():
    bumps, pits = (Bumps(height_m=h, count=30, layout="scattered", half_size_m=10.0).ground() for h in (0.1, -0.1))
    assert np.array_equal(bumps.heights, -pits.heights)
    assert bumps.heights.max() == pytest.approx(0.1, rel=0.05)
    assert bumps.heights.min() == 0.0


def test_bump_below_the_right_wheels_lifts_only_these_wheels():
    terrain = Bumps(x_m=4.0, count=1, height_m=0.08, half_size_m=12.0)
    seen = wheel_heights(terrain, 14.0, speed=0.6)
    rise = seen[:, :, 2].max(axis=0) - np.median(seen[:, :, 2], axis=0)
    right, left = rise[[1, 3]], rise[[0, 2]]
    assert right == pytest.approx([0.08, 0.08], abs=0.012)
    assert (left < 0.02).all()
    assert seen[np.argmax(seen[:, 1, 2]), 1, 0] == pytest.approx(4.0, abs=0.1)


TYRES = sorted((pytest.param(tyre, id=tyre.kind) for tyre in force_tyres()), key=lambda tyre: tyre.id != "linear")
ROUGH_GROUNDS = [
    pytest.param(Rough(iso_class="E", half_size_m=30.0), 1.5, 0.6, id="E"),
    pytest.param(Rough(iso_class="E", half_size_m=30.0, node_m=0.25), 1.5, 0.6, id="E coarse"),
    pytest.param(Ridges(depth_m=0.2, spacing_m=3.0, half_size_m=30.0), 1.0, 0.5, id="ridges"),
]


@pytest.mark.parametrize(("tyre", "terrain", "speed", "ripple"), by_turns(TYRES, ROUGH_GROUNDS))
def test_tyres_remain_stable_on_rough_ground(tyre, terrain, speed, ripple):
    """Loads stay near the static loads, and the tractor keeps its speed."""
    plant, truth = mujoco_plant(tyre, terrain)
    trace = Driver(plant, truth, speed).go(10.0)
    loads = trace.wheels[60:, 0]
    assert plant.trouble() is None
    assert plant.warnings() == 0
    assert (loads <= 0).mean() <= 0.02
    assert (loads.std(axis=0) / loads.mean(axis=0)).max() < ripple
    assert loads.max() < 8 * 2300
    assert np.abs(trace["roll"]).max() < 0.5
    assert np.abs(trace["pitch"]).max() < 0.5
    assert trace["speed"][-100:].mean() == pytest.approx(speed, rel=0.1)
    assert loads.sum(axis=1).mean() == pytest.approx(plant.tractor.mass_kg * 9.81, rel=0.05)


STEEP = {profile: Ridges(depth_m=0.2, half_size_m=30.0, profile=profile) for profile in ("sine", "flat")}
"""Furrows narrower than the wheels, with flanks of 40 deg, which is about the limit of the grip."""
PROFILES_AND_TYRES = [pytest.param(p, *tyre.values, id=f"{p}-{tyre.id}") for p, tyre in product(STEEP, TYRES)]
SPEEDS_AND_STARTS = [pytest.param(speed, x) for speed, x in ((1.5, 0.0), (5.0, 0.1), (1.5, 0.1), (5.0, 0.0))]
"""Pedal [m/s], and start position across the furrows [m]."""
STARTS = (0.0, 0.05, 0.1, 0.15, -0.05, -0.1, -0.15)
"""Start positions across the furrows [m]. Motion in steep furrows is chaotic, so the test uses a median."""


class Pedal:
    """Driver with a constant pedal, so that the rims rotate at a constant speed."""

    def __init__(self, speed):
        self.position = speed / 5.0

    def drive(self, truth):
        off = self.position - truth.pedal
        return Drive(NEUTRAL_V, NEUTRAL_V + 10.0 * off + 0.3 * np.sign(off))


@pytest.mark.parametrize(("tyre", "profile"), by_turns(TYRES[1:], STEEP))
def test_steep_furrows_may_stop_the_tractor_but_not_lift_it(tyre, profile):
    """The tyre `linear` is omitted, because without a grip limit it climbs any slope and jumps."""
    ground, found = STEEP[profile].ground(), []
    for x in STARTS:
        plant, truth = mujoco_plant(tyre, ground, start=ORIGIN._replace(x=x))
        pedal, seen = Pedal(1.5), []
        for _ in range(200):
            truth = plant.advance(pedal.drive(truth))
            seen.append([*plant.wheels()[:4], truth.roll, truth.pitch])
        assert plant.trouble() is None
        assert plant.warnings() == 0
        loads, lean = np.array(seen)[60:, :4], np.abs(np.array(seen)[:, 4:]).max()
        found.append(((loads <= 0).mean(), (loads.std(axis=0) / loads.mean(axis=0)).max(), loads.max(), lean))
    in_the_air, ripple, largest, lean = np.median(found, axis=0)
    assert in_the_air <= 0.4
    assert ripple < 3.0
    assert largest < 8 * 2300
    assert lean < 0.5


def energy_beyond_the_engines_work(plant, truth, speed, seconds):
    """Return the maximum of the tractor's energy minus its initial energy and the work of the actuators [J]."""
    model, data, pedal = plant.model, plant.data, Pedal(speed)

    def mechanical():
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return float(data.energy.sum())

    springs = float((plant.wheels()[:4] ** 2 / (2 * plant.tyred.tyres.stiffness)).sum())
    start, work, surplus = mechanical() + springs, 0.0, -np.inf
    for _ in range(round(seconds / DT)):
        before = data.qvel.copy()
        truth = plant.advance(pedal.drive(truth))
        work += DT * float(data.qfrc_actuator @ (before + data.qvel) / 2)
        surplus = max(surplus, mechanical() - start - work)
    return surplus


@pytest.mark.parametrize(("profile", "tyre", "speed", "x"), by_turns(PROFILES_AND_TYRES, SPEEDS_AND_STARTS))
def test_ground_adds_no_energy_to_the_tractor(tyre, profile, speed, x):
    """Even if the tractor jumps at full pedal, its energy comes from the engine only."""
    plant, truth = mujoco_plant(tyre, STEEP[profile], start=ORIGIN._replace(x=x), tick_s=DT)
    assert energy_beyond_the_engines_work(plant, truth, speed, 4.0) <= 0.0


def test_energy_check_detects_ground_that_does_positive_work():
    plant, truth = mujoco_plant(MagicFormula(), STEEP["sine"], tick_s=DT)
    plant.tyred.tyres.damping[:] *= -1
    assert energy_beyond_the_engines_work(plant, truth, 1.5, 4.0) > 10.0

"""Closed motions of slip, speed and load: no tyre, patch or tool returns more energy than it received."""

import numpy as np
import pytest
from wheel_steps import step_of

from agrobot_mj.extensions.bench.manoeuvres.closed_motions import HARMONICS, ROUNDING, Cycle, cycle, gains, tool_gains
from agrobot_mj.machine.implements.draught import Tool
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.tools import MEMORIES, soil_on_tool
from agrobot_mj.terrain import Flat, Ridges
from agrobot_mj.terrain.grid import height_and_gradient
from agrobot_mj.tyres import Linear, MagicFormula, Ruts, Soil
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import WheelMotion

TYRES = [Linear, MagicFormula, Soil, Ruts]
ANISOTROPIC = {"sliding_anisotropy": 1.0, "bristle_damping_s": 0.0}


def drawn(count, seed):
    rng = np.random.default_rng(seed)
    return [cycle(rng) for _ in range(count)]


def wave(mean, size=0.0, phase=0.0, harmonic=1):
    found = np.zeros(1 + 2 * HARMONICS)
    found[0], found[2 * harmonic - 1], found[2 * harmonic] = mean, size, phase
    return found


@pytest.mark.parametrize("kind", TYRES)
@pytest.mark.parametrize("damping_s", [0.0, 0.02])
def test_closed_wheel_motion_gains_no_energy(kind, damping_s):
    found = gains(kind(bristle_damping_s=damping_s), drawn(150, 5))
    assert (found[:, 0] <= ROUNDING * found[:, 1] + 1e-12).all()
    assert found[:, 1].max() > 1.0


@pytest.mark.parametrize(
    "tyre", [MagicFormula(**ANISOTROPIC), Soil(**ANISOTROPIC), Ruts(**ANISOTROPIC)], ids=lambda t: t.kind
)
def test_closed_motion_with_anisotropic_sliding_gains_no_energy(tyre):
    found = gains(tyre, drawn(60, 6))
    assert (found[:, 0] <= ROUNDING * found[:, 1] + 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", TYRES)
@pytest.mark.parametrize("damping_s", [0.0, 0.02])
def test_a_thousand_closed_wheel_motions_gain_no_energy(kind, damping_s):
    found = gains(kind(bristle_damping_s=damping_s), drawn(1000, 8))
    assert (found[:, 0] <= ROUNDING * found[:, 1] + 1e-12).all()


@pytest.mark.parametrize("kind", [MagicFormula, Soil, Ruts])
@pytest.mark.parametrize("speed", [0.0, 0.7])
@pytest.mark.parametrize("hertz", [0.9, 2.3])
def test_load_oscillation_at_twice_sliding_frequency_adds_no_energy(kind, speed, hertz):
    """The wheel slides 9 mm to each side, while its load falls to a quarter, at any phase."""
    sideways = wave(0.0, 0.009 * 2 * np.pi * hertz)
    motions = [
        Cycle(2, 1 / hertz, wave(speed), sideways, wave(0.0), wave(0.0144, 0.75 * 0.0144, phase, harmonic=2))
        for phase in np.linspace(0.0, 2 * np.pi, 13)
    ]
    found = gains(kind(bristle_damping_s=0.0), motions)
    assert (found[:, 0] < 0.0).all()


@pytest.mark.parametrize("kind", [MagicFormula, Soil])
@pytest.mark.parametrize(("depth_m", "spacing_m", "gained"), [(0.03, 3.0, 1e-4), (0.1, 1.0, 0.02)])
def test_wheel_that_leans_on_a_ridge_gains_no_energy(kind, depth_m, spacing_m, gained):
    """On short ridges, the ground normal changes within the motion; without the carcass, the gain is 15 %."""
    ridges = Ridges(
        half_size_m=4.0, run_in_m=0.01, depth_m=depth_m, spacing_m=spacing_m, furrow_direction_deg=0.0
    ).ground()
    for phase in np.linspace(0.0, 2 * np.pi, 9)[:-1]:
        work, exchanged = leaning(kind, phase, ridges, 0.13)
        assert work <= gained * exchanged


@pytest.mark.parametrize("kind", [MagicFormula, Soil, Ruts])
@pytest.mark.parametrize("phase", np.linspace(0.0, 2 * np.pi, 9)[:-1])
def test_non_rolling_wheel_that_leans_and_shifts_sideways_gains_no_energy(kind, phase):
    work, exchanged = leaning(kind, phase, Flat().ground())
    assert work <= 1e-4 * exchanged


def leaning(kind, phase, ground, y=0.0):
    """Return the work on a wheel in a closed motion at `y` [m], and the energy exchanged [J].

    The wheel leans by 3.4 deg and its contact point moves by 20 mm to each side, at a constant height.
    """
    tyres, i, n = tyre_set(kind(bristle_damping_s=0.0), TractorParameters()), 2, 1000
    tyres.damping[:] = 0.0
    h, base = tyres.radius[i] - 2400.0 / tyres.stiffness[i], height_and_gradient(ground, 0.0, y)[0]
    bristle, wrench, report, work, exchanged = np.zeros(4), np.zeros(6), np.zeros(6), 0.0, 0.0
    wheel_step = step_of(tyres, ground)
    for k in range(3 * n):
        t, moved = 2 * np.pi * (k + 0.5) / n, wrench.copy()
        lean, rate = 0.06 * np.sin(t), 0.06 * 2 * np.pi * np.cos(t)
        place = (0.0, y + 0.02 * np.sin(t + phase) - h * np.sin(lean), base + h * np.cos(lean))
        v_y = 0.02 * 2 * np.pi * np.cos(t + phase) - h * np.cos(lean) * rate
        velocity = (0.0, v_y, -h * np.sin(lean) * rate)
        motion = WheelMotion(place, (0.0, np.cos(lean), np.sin(lean)), velocity, (rate, 0.0, 0.0))
        wheel_step(tyres, i, ground, motion, 1 / n, bristle, wrench, report)
        power = 0.5 * (moved + wrench)[1:4] @ (*velocity[1:], rate)
        work, exchanged = (work + power / n, exchanged + abs(power) / n) if k >= 2 * n else (0.0, 0.0)
    assert exchanged > 10.0
    return work, exchanged


def test_closed_tool_motion_gains_no_energy():
    found = tool_gains(drawn(80, 7))
    assert (found[:, 0] <= ROUNDING * found[:, 1] + 1e-12).all()


def test_tool_moved_forward_shallow_and_backward_deep_gains_no_energy():
    law, memory, work = Tool(depth_m=0.12, suction_share=0.0).law(), np.zeros(MEMORIES), []
    for _ in range(4):
        work.append(0.0)
        for v, depth in ((0.1, 0.03), (-0.1, 0.14)):
            for _ in range(100):
                work[-1] += soil_on_tool(law, 1.0, v, 0.0, depth, 0.002, memory)[0] * v * 0.002
    assert max(work) < 0.0


@pytest.mark.parametrize("phase", np.linspace(0.0, 2 * np.pi, 9)[:-1])
def test_wheel_turned_under_an_oscillating_load_gains_no_energy(phase):
    tyres, dt, n = tyre_set(MagicFormula(), TractorParameters()), 0.001, 1000
    tyres.damping[:] = 0.0
    bristle, wrench, report, work = np.zeros(4), np.zeros(6), np.zeros(6), 0.0
    ground = Flat().ground()
    wheel_step = step_of(tyres, ground)
    for k in range(3 * n):
        t, moment = k / n, wrench[5]
        sunk, turn = 0.0117 * (1 + 0.7 * np.sin(4 * np.pi * t + phase)), 0.2 * np.cos(2 * np.pi * t)
        motion = WheelMotion((0.0, 0.0, 0.28 - sunk), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, turn))
        wheel_step(tyres, 0, ground, motion, dt, bristle, wrench, report)
        work += 0.5 * (moment + wrench[5]) * turn * dt if k >= 2 * n else 0.0
    assert work <= 1e-9

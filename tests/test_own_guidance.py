"""Guidance of the riding tractor: its board, the steady-state offset of the twin, and the stop without RTK."""

from math import cos, degrees, radians, sin, tan

import numpy as np
import pytest
from riding_tractor import (
    BEGIN_S,
    CENTRE,
    FAILURES,
    LARGEST,
    LEFT,
    LOOKAHEAD_M,
    RIGHT,
    WHEELBASE_M,
    Board,
    Loop,
    Pursuit,
    calibrated,
    steady_offset,
    twin,
)

STRAIGHT, SCALE = 432.0, 0.15  # Reading straight ahead [counts], and scale [deg per count]
LEVEL = {"kind": "flat"}
PLAY = LOOKAHEAD_M**2 * np.tan(radians(10 * SCALE)) / (2 * WHEELBASE_M) + 0.01
"""Offset due to the dead band of 10 counts, plus a centimetre for noise [m]."""


def line(length, step=0.49, lookahead=2.0):
    """Return waypoints along a line to the east."""
    x = np.arange(0.0, length, step)
    return np.column_stack((x, np.zeros_like(x), np.full_like(x, lookahead)))


def test_steering_board_maps_full_lock_to_the_stops():
    readings = [Board().wanted(angle) for angle in (-1.0, -LARGEST, 0.0, LARGEST, 1.0)]
    assert readings == pytest.approx([RIGHT, RIGHT, CENTRE, LEFT, LEFT])


def test_motor_command_is_zero_in_the_dead_band_and_at_least_150_outside():
    drives = [Board().drive(error) for error in (10.0, -10.0, 11.0, -11.0, 200.0, 400.0)]
    assert drives == [0.0, 0.0, 150.0, -150.0, 200.0, 255.0]
    assert [Board().voltage(error) for error in (0.0, 400.0, -400.0)] == [6.0, 12.0, 0.0]


def test_calibrated_board_measures_true_steering_angles():
    board = calibrated(STRAIGHT, SCALE)
    assert board.wanted(radians(15.0)) == pytest.approx(STRAIGHT + 100.0)
    assert board.bias(STRAIGHT) == 0.0
    assert degrees(Board().bias(STRAIGHT)) == pytest.approx(15.0 / 250.0 * degrees(LARGEST))


def test_pure_pursuit_steers_to_the_first_waypoint_outside_its_radius():
    pursuit, angle = Pursuit(line(10.0)).after(0.0, -0.5, 0.0)
    assert pursuit.waypoints[pursuit.index, 0] == pytest.approx(1.96), "hypot(1.96, 0.5) > 2"
    assert angle == pytest.approx(np.arctan(2 * 1.27 * 0.5 / 4.0))
    assert Pursuit(line(10.0), 20).after(9.4, 0.0, 0.0)[0].done


@pytest.mark.parametrize(("straight", "heading"), [(432.0, 0.0), (432.0, 1.0), (470.0, 0.0), (400.0, -1.0)])
@pytest.mark.parametrize("lookahead", [2.0, 3.0])
def test_analytic_steady_state_offset_agrees_with_a_kinematic_bicycle(straight, heading, lookahead):
    """The bicycle is simulated until it settles; the waypoint spacing limits the accuracy."""
    pursuit, board, dt = Pursuit(line(120.0, 0.1, lookahead)), Board(), 0.05
    x = y = yaw = 0.0
    pot = straight
    for _ in range(4000):
        pursuit, angle = pursuit.after(x, y, yaw + radians(heading))
        reach = 40.0 * dt / SCALE
        pot += min(max(board.wanted(angle) - pot, -reach), reach)
        yaw += 0.5 * tan(radians(SCALE * (pot - straight))) / WHEELBASE_M * dt
        x, y = x + 0.5 * cos(yaw) * dt, y + 0.5 * sin(yaw) * dt
    assert y == pytest.approx(steady_offset(board.bias(straight), radians(heading), lookahead), abs=0.012)


@pytest.fixture(scope="module")
def machine():
    return twin()


@pytest.mark.parametrize("straight", [447.0, 400.0])
def test_offset_matches_theory_within_the_dead_band_of_the_board(machine, straight):
    found = Loop(machine, straight, SCALE).run(0.5, 1, LEVEL).middle
    expected = steady_offset(Board().bias(straight), 0.0)
    assert found.left / 100 == pytest.approx(expected, abs=PLAY)
    assert found.speed == pytest.approx(0.5, rel=0.05)


def test_board_with_the_correct_sensor_scale_stays_on_the_line(machine):
    found = Loop(machine, 400.0, SCALE, board=calibrated(400.0, SCALE)).run(0.5, 1, LEVEL).middle
    assert abs(found.left) / 100 < PLAY < steady_offset(Board().bias(400.0), 0.0)


def test_loss_of_fixes_stops_the_tractor_unless_its_last_fix_was_rtk(machine):
    """If a receiver is silent, its last RTK fix remains valid."""
    ways = {}
    for name in ("position silent for 37 s, last fix of quality 2", "position silent for 37 s, last fix RTK"):
        fault = {"start_s": BEGIN_S, **FAILURES[name]}
        rows = Loop(machine, 447.0, SCALE).run(0.5, 1, LEVEL, (fault,), 40.0).rows
        after = rows[:, (rows[0] >= BEGIN_S) & (rows[0] < BEGIN_S + 30.0)]
        ways[name] = after[4][-1] - after[4][0]
    stopped, believed = ways.values()
    assert stopped < 1.0
    assert believed > 10.0

"""The riding tractor's guidance: the board's law, and the offset at which pure pursuit settles."""

from math import degrees, radians

import numpy as np
import pytest
from clones import STRAIGHT, Drive, line
from riding_tractor.closed_loop import CENTRE, LARGEST, LEFT, RIGHT, Board, Pursuit, calibrated, steady_offset


def test_the_board_maps_full_lock_to_the_stops():
    readings = [Board().wanted(angle) for angle in (-1.0, -LARGEST, 0.0, LARGEST, 1.0)]
    assert readings == pytest.approx([RIGHT, RIGHT, CENTRE, LEFT, LEFT])


def test_the_motor_gets_nothing_within_the_dead_band_and_its_least_drive_beyond():
    drives = [Board().drive(error) for error in (10.0, -10.0, 11.0, -11.0, 200.0, 400.0)]
    assert drives == [0.0, 0.0, 150.0, -150.0, 200.0, 255.0]
    assert [Board().voltage(error) for error in (0.0, 400.0, -400.0)] == [6.0, 12.0, 0.0]


def test_a_calibrated_board_reads_true_angles():
    board = calibrated(STRAIGHT, 0.15)
    assert board.wanted(radians(15.0)) == pytest.approx(STRAIGHT + 100.0)
    assert board.bias(STRAIGHT) == 0.0


def test_a_firmware_centre_too_far_left_asks_for_a_command_to_the_right():
    assert degrees(Board().bias(STRAIGHT)) == pytest.approx(15.0 / 250.0 * degrees(LARGEST))
    assert Board().bias(CENTRE + 30.0) < 0.0


def test_it_steers_for_the_first_waypoint_out_of_reach():
    pursuit, angle = Pursuit(line(10.0)).after(0.0, -0.5, 0.0)
    assert pursuit.waypoints[pursuit.index, 0] == pytest.approx(1.96), "hypot(1.96, 0.5) > 2"
    assert angle == pytest.approx(np.arctan(2 * 1.27 * 0.5 / 4.0))
    assert Pursuit(line(10.0), 20).after(9.4, 0.0, 0.0)[0].done


@pytest.mark.parametrize(("straight", "heading"), [(432.0, 0.0), (432.0, 1.0), (470.0, 0.0), (400.0, -1.0)])
@pytest.mark.parametrize("lookahead", [2.0, 3.0])
def test_the_steady_offset_is_that_of_a_tractor_without_slip(straight, heading, lookahead):
    """Against a bicycle that is driven until it has settled; waypoints up to one step beyond the reach blur it."""
    drive = Drive(line(120.0, 0.1, lookahead), straight, heading)
    drive.run(200.0)
    assert drive.y == pytest.approx(steady_offset(Board().bias(straight), radians(heading), lookahead), abs=0.012)

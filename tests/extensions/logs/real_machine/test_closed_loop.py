"""The owner's guidance on the twin: where it settles, and what its gate does."""

from math import radians

import numpy as np
import pytest
from riding_tractor.closed_loop import LOOKAHEAD_M, WHEELBASE_M, Board, Loop, calibrated, steady_offset
from riding_tractor.gnss import BEGIN_S, FAILURES
from riding_tractor.prediction import Motor, twin

MOTOR, SCALE = Motor(dead_band=71.0, rate=0.58), 0.15
LEVEL = {"kind": "flat"}
PLAY = LOOKAHEAD_M**2 * np.tan(radians(10 * SCALE)) / (2 * WHEELBASE_M) + 0.01
"""Offset that the dead band of 10 counts leaves undecided, and a centimetre of noise [m]."""


@pytest.fixture(scope="module")
def machine():
    return twin(MOTOR)


@pytest.mark.parametrize("straight", [447.0, 400.0])
def test_it_settles_within_the_dead_band_about_the_steady_offset(machine, straight):
    found = Loop(machine, straight, SCALE).run(0.5, 1, LEVEL).middle
    expected = steady_offset(Board().bias(straight), 0.0)
    assert found.left / 100 == pytest.approx(expected, abs=PLAY)
    assert found.speed == pytest.approx(0.5, rel=0.05)


def test_a_board_that_knows_its_sensor_stays_on_the_line(machine):
    found = Loop(machine, 400.0, SCALE, board=calibrated(400.0, SCALE)).run(0.5, 1, LEVEL).middle
    assert abs(found.left) / 100 < PLAY < steady_offset(Board().bias(400.0), 0.0)


def test_the_gate_stops_a_tractor_without_an_rtk_fix_and_not_one_that_is_told_lies(machine):
    """A silent receiver whose last words were an RTK fix is believed."""
    ways = {}
    for name in ("position silent for 37 s, last fix of quality 2", "position silent for 37 s, last fix RTK"):
        fault = {"start_s": BEGIN_S, **FAILURES[name]}
        rows = Loop(machine, 447.0, SCALE).run(0.5, 1, LEVEL, (fault,), 40.0).rows
        after = rows[:, (rows[0] >= BEGIN_S) & (rows[0] < BEGIN_S + 30.0)]
        ways[name] = after[4][-1] - after[4][0]
    stopped, believed = ways.values()
    assert stopped < 1.0
    assert believed > 10.0

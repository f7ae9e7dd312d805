"""How fast the wheels of a full-size tractor turn by hand, from its CAN bus, beside the simulator's valve.

A Massey Ferguson 7720 that stands with its engine idling, turned from lock to lock by the driver: its orbitrol, not the
valve of its auto-steer. The steering reports the curvature (PGN 44032); the wheel angle is atan(L kappa).
"""

from math import degrees
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agrobot_mj import load_scenario
from agrobot_mj.core.signals import NEUTRAL_V, Array
from agrobot_mj.extensions.logs.readers.can import CanText
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE
from riding_tractor.logs import Repository

SCAN = "Show_All_CAN_Messages/Show_All_CAN_Messages/scan mf7720 bl 270922 speedsteer enable.txt"
WHEELBASE_M = 2.88
"""Wheelbase of the tractor [m]. Maker."""
AGES_S = np.arange(-0.1, 0.5, 0.01)
"""Ages of the wheels behind the steering wheel that are tried [s]."""
FREE_DEG = 40.0
"""Wheel angle within which they are off their stops, against which the hand may turn on [deg]."""
EVEN_S, STEP_S = 0.05, 0.5
"""Grid on which both angles are compared, and time over which they change [s]."""


class Steering(NamedTuple):
    """Steering of the tractor, as its bus tells it."""

    over_1_s: float  # largest rate of the wheels sustained over a second [deg/s]
    over_half_s: float  # largest rate over half a second [deg/s]
    lock: float  # largest wheel angle [deg]
    left_per_turn: float  # wheel angle for a turn of the steering wheel while turning left [deg]
    right_per_turn: float
    explained: float  # share of the variance of the wheels' rate that the steering wheel's explains [-]
    lag: float  # time by which the wheels follow [s]


def measured(repository: Repository, folder: Path) -> Steering:
    """Steering in the scan; `folder` takes a copy of it for the reader."""
    file = folder / "scan.txt"
    file.write_bytes(repository.read(SCAN))
    return steering(file)


def steering(file: Path) -> Steering:
    """Steering in a log of a CAN bus."""
    table = CanText().read(file).source
    t, curvature, hand = (table[name].to_numpy() for name in ("t", "curvature", "steering_wheel"))
    known, held = np.isfinite(curvature), np.isfinite(hand)
    wheel, at = np.degrees(np.arctan(WHEELBASE_M * curvature[known])), t[known]
    turned, when = np.degrees(np.unwrap(hand[held])), t[held]
    even = np.arange(at[0], at[-1], EVEN_S)
    angle = np.interp(even, at, wheel)
    steps, free = _steps(angle), np.abs(angle[round(STEP_S / EVEN_S) :]) < FREE_DEG
    fits = [_line(steps[free], _steps(np.interp(even - age, when, turned))[free]) for age in AGES_S]
    best = int(np.argmax([explained for explained, *_ in fits]))
    explained, left, right = fits[best]
    rates = (_fastest(at, wheel, seconds) for seconds in (1.0, 0.5))
    return Steering(*rates, float(np.abs(wheel).max()), 360 * left, 360 * right, explained, float(AGES_S[best]))


def _steps(angle: Array) -> Array:
    """Changes of an angle on the even grid over `STEP_S`."""
    n = round(STEP_S / EVEN_S)
    return angle[n:] - angle[:-n]


def _line(wheel: Array, hand: Array) -> tuple[float, float, float]:
    """Share of the steps of the wheels [deg] that those of the steering wheel explain, and their ratio either way."""
    ratios = [float(wheel[way] @ hand[way] / (hand[way] @ hand[way])) for way in (hand > 0, hand <= 0)]
    rest = wheel - np.where(hand > 0, *ratios) * hand
    return 1.0 - float(np.var(rest) / np.var(wheel)), *ratios


def _fastest(t: Array, angle: Array, seconds: float) -> float:
    """Largest mean rate over a stretch of time [deg/s]."""
    begin = t[t < t[-1] - seconds]
    return float(np.abs(np.interp(begin + seconds, t, angle) - np.interp(begin, t, angle)).max()) / seconds


def valve_rates() -> tuple[float, float]:
    """Largest steering rates of the simulator's valve to the left and to the right, of the default tractor [deg/s]."""
    steering = load_scenario("straight_line").steering
    valve, full = steering.valve, NEUTRAL_V - steering.valve.dead_band_v
    flows = (min(gain * full, valve.largest_flow) for gain in (valve.gain_left_l_min_v, valve.gain_right_l_min_v))
    left, right = (degrees(flow * LITRE_PER_MINUTE / steering.cylinder.displacement) for flow in flows)
    return left, right

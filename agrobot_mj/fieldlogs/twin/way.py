"""The way of a recording as waypoints of a scenario: its longest drive forward, without the noise of the receiver."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.signal import savgol_filter

from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.pieces import spells
from agrobot_mj.fieldlogs.recording import FieldRecording

SPACING_M = 0.5
"""Distance between waypoints [m]."""
SMOOTHED_S = 2.0
"""Length of the cubic that smooths positions [s]."""
SLOWEST_M_S = 0.1
"""Slowest speed of a waypoint [m/s]."""


def way(pieces: Sequence[FieldRecording], cg_to_rear_axle: float) -> Array | None:
    """East, north [m] and speed [m/s] of the CG on the longest drive forward, shape (n, 3); None where it is short."""
    legs = [leg for piece in pieces if piece.position is not None for leg in _forward(piece)]
    found = max(legs, key=len, default=None)
    return None if found is None or len(found) < 4 else _at_cg(found, cg_to_rear_axle)


def _forward(piece: FieldRecording) -> list[Array]:
    """Legs of R forward in even steps, each of shape (n, 4): east, north, speed and heading."""
    assert piece.position is not None
    t, places = piece.position
    u = np.interp(t, piece.speed.t, piece.speed.value)
    least = 2 * SMOOTHED_S / np.median(np.diff(t))
    return [_leg(piece, t[a:b], places[a:b]) for a, b in spells(u > SLOWEST_M_S) if b - a > least]


def _leg(piece: FieldRecording, t: Array, places: Array) -> Array:
    spacing = float(np.median(np.diff(t)))
    even = np.arange(t[0], t[-1], spacing)
    window = max(5, 2 * round(SMOOTHED_S / spacing / 2) + 1)
    x, y = (savgol_filter(np.interp(even, t, each), window, 3) for each in places.T)
    yaw = piece.heading.at(even) if piece.heading else np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    ahead, left, _ = piece.arm
    x, y = x - ahead * np.cos(yaw) + left * np.sin(yaw), y - ahead * np.sin(yaw) - left * np.cos(yaw)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    at = np.arange(0.0, driven[-1], SPACING_M)
    u = np.interp(even, piece.speed.t, piece.speed.value)
    return np.column_stack([np.interp(at, driven, each) for each in (x, y, u, yaw)])


def _at_cg(leg: Array, cg_to_rear_axle: float) -> Array:
    x, y, u, yaw = leg.T
    return np.column_stack([x + cg_to_rear_axle * np.cos(yaw), y + cg_to_rear_axle * np.sin(yaw), u])


def waypoint_text(points: Array) -> str:
    """Waypoints as CSV."""
    rows = [f"{x:.3f},{y:.3f},{max(u, SLOWEST_M_S):.3f}" for x, y, u in points]
    kept = [rows[0], *(b for a, b in pairwise(rows) if a.split(",")[:2] != b.split(",")[:2])]
    return "\n".join(["x,y,speed", *kept]) + "\n"

"""The riding tractor's own guidance, as its logs and its code at the stated commit show it.

Pure pursuit of the first waypoint that is farther than the look-ahead away, with the raw position and heading; the
board drives the steering motor by a proportional law with a dead band and a least drive, in counts of the steering
potentiometer. It waits, with wheels for the firmware's centre, while the fix is not RTK or the heading not valid.
"""

from math import atan, cos, degrees, sin, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import NEUTRAL_V, Array

WHEELBASE_M, LOOKAHEAD_M, LARGEST = 1.27, 2.0, 0.623
"""Wheelbase, look-ahead of the straight missions and largest steering angle of the guidance [m, m, rad]."""
RIGHT, CENTRE, LEFT = 197.0, 447.0, 815.0
"""Readings of the potentiometer that the firmware takes for full right, straight ahead and full left [counts]."""
KP, DEAD_BAND, LEAST, MOST = 1.0, 10.0, 150.0, 255.0
"""Gain [counts of drive per count], dead band [counts], least and largest drive [counts of 255]."""
WAYPOINTS_M = 0.49
"""Distance between waypoints of the straight missions [m]."""
GOAL_M = 0.5
"""Distance from the last waypoint, along the heading, at which a mission ends [m]."""


class Board(NamedTuple):
    """The steering board, and what its owner may set."""

    centre: float = CENTRE
    """Reading straight ahead [counts]."""
    left: float = (LEFT - CENTRE) / LARGEST
    """Counts per radian to the left."""
    right: float = (CENTRE - RIGHT) / LARGEST
    """Counts per radian to the right."""
    dead_band: float = DEAD_BAND

    def wanted(self, angle: float) -> float:
        """Reading for a steering angle [rad], left positive [counts]."""
        angle = min(max(angle, -LARGEST), LARGEST)
        return self.centre + angle * (self.left if angle > 0 else self.right)

    def bias(self, straight: float) -> float:
        """Angle to the right that it commands while the wheels are straight ahead at this reading [rad]."""
        return (self.centre - straight) / (self.right if straight < self.centre else self.left)

    def drive(self, error: float) -> float:
        """Drive of the motor for an error [counts], left positive [counts of 255]."""
        if abs(error) <= self.dead_band:
            return 0.0
        size = min(max(KP * abs(error), LEAST), MOST)
        return size if error > 0 else -size

    def voltage(self, error: float) -> float:
        """The drive as the simulator's valve takes it, 12 V full left [V]."""
        return NEUTRAL_V * (1.0 + self.drive(error) / MOST)


def calibrated(centre: float, degrees_per_count: float) -> Board:
    """A board that knows its sensor."""
    scale = degrees(1.0) / degrees_per_count
    return Board(centre, scale, scale)


class Pursuit(NamedTuple):
    """Pure pursuit between two ticks."""

    waypoints: Array
    """East, north and look-ahead, shape (n, 3) [m]."""
    index: int = 0
    """Waypoint that it steers for."""
    done: bool = False

    def after(self, x: float, y: float, yaw: float) -> "tuple[Pursuit, float]":
        """Steering angle, left positive [rad], at a position [m] and heading [rad]."""
        places, reach = self.waypoints[self.index :, :2], self.waypoints[self.index :, 2]
        beyond = np.flatnonzero(np.hypot(*(places - (x, y)).T) > reach)
        last = len(self.waypoints) - 1
        k = self.index + int(beyond[0]) if beyond.size else last
        dx, dy, lookahead = (self.waypoints[k] - (x, y, 0.0)).tolist()
        ahead, left = dx * cos(yaw) + dy * sin(yaw), dy * cos(yaw) - dx * sin(yaw)
        done = not beyond.size and ahead <= GOAL_M
        return self._replace(index=k, done=done), atan(2.0 * WHEELBASE_M * left / lookahead**2)


def steady_offset(bias: float, heading: float, lookahead: float = LOOKAHEAD_M) -> float:
    """Offset to the left at which pure pursuit holds wheels straight ahead [m].

    Of a board that has to command `bias` [rad] to the right for that, under a heading that points `heading` [rad] too
    far left: the waypoint then appears  y_t = L_d^2 tan(bias) / (2 L)  to the right, of which the heading's error makes
    L_d sin(heading).
    """
    return lookahead**2 * tan(bias) / (2.0 * WHEELBASE_M) - lookahead * sin(heading)

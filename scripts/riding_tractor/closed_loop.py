"""The riding tractor's guidance, and its twin under it over ground of a given roughness, beside its recorded passes.

The guidance is as the logs and the code at the stated commit show it: pure pursuit of the first waypoint that is
farther than the look-ahead away, with the raw position and heading; the board drives the steering motor by a
proportional law with a dead band and a least drive, in counts of the steering potentiometer. It waits, with wheels for
the firmware's centre, while the fix is not RTK or the heading not valid. It needs neither estimator nor supervisor of
ours. Positions count as the receiver writes them, to 1e-5 minutes.
"""

from collections.abc import Sequence
from math import atan, cos, degrees, isfinite, nan, radians, sin, tan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj import Simulation
from agrobot_mj.core.signals import NEUTRAL_V, Array, Measurement, Quality
from agrobot_mj.scenario import Scenario
from agrobot_mj.terrain.rough import ROUGHNESS, Rough
from riding_tractor.logs import PursuitLog

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

    centre: float = CENTRE  # reading straight ahead [counts]
    left: float = (LEFT - CENTRE) / LARGEST  # counts per radian to the left
    right: float = (CENTRE - RIGHT) / LARGEST  # counts per radian to the right
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

    waypoints: Array  # east, north and look-ahead, shape (n, 3) [m]
    index: int = 0  # waypoint that it steers for
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


MIDDLE = (0.4, 0.8)
"""Part of a pass that counts, by waypoints, as the owner counts."""
LATITUDE = 40.4856
"""Latitude of the field [deg]."""
CELL = (1e-5 / 60 * 111.32e3 * cos(radians(LATITUDE)), 1e-5 / 60 * 111.04e3)
"""Steps of the written position, east and north: 1e-5 minutes [m]."""
POSITION_TICKS, HEADING_TICKS = 2, 4
"""Ticks between new positions and between new headings: 10 and 5 Hz, as in the logs."""
LENGTH_M = 26.0
"""Length of a pass [m]; the longest recorded one has 25.5 m."""
ROUGH_HALF_M, ROUGH_NODE_M = 32.0, 0.05
"""Half side of the rough ground, and distance of its nodes [m]."""


class Pass(NamedTuple):
    """Distance from the line in the middle of a pass, left of the vehicle positive."""

    offset: Array  # distances [m]
    wanted: Array  # steering angle that the guidance asks for, left positive [deg]
    speed: float  # mean speed [m/s]

    @property
    def mean(self) -> float:
        """Mean distance [cm]."""
        return 100 * float(np.abs(self.offset).mean())

    @property
    def p95(self) -> float:
        """Distance that one sample in twenty exceeds [cm]."""
        return 100 * float(np.percentile(np.abs(self.offset), 95))

    @property
    def left(self) -> float:
        """Mean offset to the left [cm]."""
        return 100 * float(self.offset.mean())


def recorded(log: PursuitLog) -> Pass:
    """The middle of a recorded pass, beside the line through its waypoints."""
    drives = log.driving > 0
    _, first = np.unique(log.index[drives], return_index=True)
    targets = np.column_stack((log.target_x[drives], log.target_y[drives]))[first]
    along = (targets[-1] - targets[0]) / np.hypot(*(targets[-1] - targets[0]))
    inside = drives & (log.index >= MIDDLE[0] * log.total) & (log.index <= MIDDLE[1] * log.total)
    places = np.column_stack((log.x, log.y))[inside] - targets[0]
    way, time = np.ptp(places @ along), np.ptp(log.t[inside])
    return Pass(places @ np.array((-along[1], along[0])), log.wanted[inside], float(way / time))


def rough_ground(folder: Path, seed: int) -> Path:
    """A file with a square of rough ground of class C [m], written once."""
    file = folder / f"rough-{seed}.npy"
    if not file.exists():
        axis = np.arange(-ROUGH_HALF_M, ROUGH_HALF_M + ROUGH_NODE_M / 2, ROUGH_NODE_M)
        folder.mkdir(parents=True, exist_ok=True)
        np.save(file, Rough(iso_class="C", seed=seed).bare(axis, axis))
    return file


def terrain(folder: Path, seed: int, roughness: float) -> dict[str, Any]:
    """Ground of a roughness G_d(n_0) [m3]; level where it is zero."""
    if not roughness:
        return {"kind": "flat"}
    file, scale = rough_ground(folder, seed), (roughness / ROUGHNESS["C"]) ** 0.5
    return {"kind": "heightmap", "file": str(file), "spacing_m": ROUGH_NODE_M, "scale": scale}


class Loop(NamedTuple):
    """A twin under its guidance; what the owner may change."""

    twin: Scenario
    centre: float  # true reading straight ahead [counts]
    degrees_per_count: float  # true scale of the potentiometer, left positive
    board: Board = Board()
    heading_error: float = 0.0  # constant error of the heading, left positive [deg]
    gate: bool = True  # whether it waits for an RTK fix and a valid heading

    def run(
        self, speed: float, seed: int, ground: dict[str, Any], fault: Sequence[Any] = (), length: float = LENGTH_M
    ) -> "Driven":
        """Drive a straight line eastwards at a speed [m/s] over some ground."""
        line = {"kind": "line", "length_m": length, "speed_m_s": speed, "start_x_m": -length / 2}
        x = np.arange(-length / 2, length / 2 + 1e-9, WAYPOINTS_M)
        waypoints = np.column_stack((x, np.zeros_like(x), np.full_like(x, LOOKAHEAD_M), np.full_like(x, speed)))
        changes = {"path": line, "terrain": ground, "seed": seed, "fault": list(fault)}
        return self.follow(changes, waypoints)

    def follow(self, changes: dict[str, Any], waypoints: Array) -> "Driven":
        """Drive waypoints (n, 4), east, north, look-ahead [m] and speed [m/s], until mission or scenario ends."""
        heading = {"sensors.gnss.dual_antenna.mounting_deg": self.heading_error}
        simulation = Simulation(self.twin.changed({**changes, **heading}))
        measured, pursuit = simulation.reset(), Pursuit(waypoints[:, :3])
        pose, rows, tick = (nan, nan, nan), [], 0
        while not simulation.done and not pursuit.done:
            pose, sound = _pose(pose, measured, tick)
            going, angle = isfinite(sum(pose)) and (sound or not self.gate), 0.0
            if going:
                pursuit, angle = pursuit.after(*pose)
            reading = self.centre + degrees(measured.steer) / self.degrees_per_count
            volts = self.board.voltage(self.board.wanted(angle) - reading)
            truth = simulation.truth
            rows.append((truth.t, *pose, truth.rear_x, truth.rear_y, truth.speed, degrees(angle), pursuit.index))
            speed = float(waypoints[pursuit.index, 3]) if going else 0.0
            measured = simulation.step(steer_voltage=volts, speed=speed)
            tick += 1
        return Driven(np.array(rows).T, waypoints)


class Driven(NamedTuple):
    """A simulated pass."""

    rows: Array
    """Time, measured east, north and heading, true east and north of the rear axle, speed, wanted angle [deg] and
    waypoint, shape (9, n)."""
    waypoints: Array

    @property
    def middle(self) -> Pass:
        """The middle of a straight pass eastwards, by the measured positions."""
        index, total = self.rows[8], len(self.waypoints)
        inside = (index >= MIDDLE[0] * total) & (index <= MIDDLE[1] * total)
        return Pass(self.rows[2][inside], self.rows[7][inside], float(self.rows[6][inside].mean()))


def _pose(
    last: tuple[float, float, float], measured: Measurement, tick: int
) -> tuple[tuple[float, float, float], bool]:
    """The pose that the guidance knows, and whether its gate would let it drive: position and heading are held."""
    fix, (x, y, yaw) = measured.fix, last
    if fix is None:
        return last, False
    if tick % POSITION_TICKS == 0:
        x, y = (CELL[k] * round(value / CELL[k]) for k, value in enumerate((fix.x, fix.y)))
    if tick % HEADING_TICKS == 0 and fix.heading == fix.heading:
        yaw = fix.heading
    return (x, y, yaw), measured.quality == Quality.FIX and fix.heading == fix.heading

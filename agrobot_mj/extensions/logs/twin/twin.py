"""Digital twin of a machine from its logs: calibration, identification, replay of the rest of the logs, and files.

One fit estimates sensors and vehicle, so that intervals of stiffnesses include the uncertainty of the steering scale.
The evaluation uses the part of the logs that the fit did not use.
"""

import tempfile
from collections.abc import Sequence
from itertools import pairwise
from math import ceil, inf, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Source, source_name
from agrobot_mj.extensions.logs.annotated import annotated_toml
from agrobot_mj.extensions.logs.calibrate import Calibration, calibrate_log, steered_map
from agrobot_mj.extensions.logs.identify.model import wheel_angle
from agrobot_mj.extensions.logs.identify.vehicle import vehicle_quantities
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.origin import log_identity
from agrobot_mj.extensions.logs.pieces import read_pieces, spells, split_at
from agrobot_mj.extensions.logs.quantities import Quantity
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.driving import Driven
from agrobot_mj.extensions.logs.replay.result import ReplayResult, replay_pieces
from agrobot_mj.extensions.logs.series import TimeSeries
from agrobot_mj.extensions.logs.twin.machine import BACKLASH, TwinKey, machine_data, twin_faults, twin_keys
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario

SPACING_M = 0.5  # Distance between waypoints [m]
SMOOTHED_S = 2.0  # Duration of the local cubic fits that smooth positions [s]
SLOWEST_M_S = 0.1  # Minimum speed of waypoints [m/s]


def way(pieces: Sequence[FieldRecording], cg_to_rear_axle: float) -> Array | None:
    """Return the longest forward section of the CG track: east, north [m] and speed [m/s], shape (n, 3). Return None if
    no section has four waypoints."""
    legs = [leg for piece in pieces if piece.position is not None for leg in _forward(piece)]
    found = max(legs, key=len, default=None)
    return None if found is None or len(found) < 4 else _at_cg(found, cg_to_rear_axle)


def _forward(piece: FieldRecording) -> list[Array]:
    """Return the forward sections of the track of the rear-axle centre R at equal distances: east, north [m], speed
    [m/s], heading [rad], shape (n, 4) each."""
    assert piece.position is not None
    t, places = piece.position
    u = np.interp(t, *piece.speed)
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
    u = np.interp(even, *piece.speed)
    return np.column_stack([np.interp(at, driven, each) for each in (x, y, u, yaw)])


def _at_cg(leg: Array, cg_to_rear_axle: float) -> Array:
    x, y, u, yaw = leg.T
    return np.column_stack([x + cg_to_rear_axle * np.cos(yaw), y + cg_to_rear_axle * np.sin(yaw), u])


def waypoint_text(points: Array) -> str:
    """Return waypoints (east, north [m], speed [m/s]) as CSV text, without repeated positions."""
    rows = [f"{x:.3f},{y:.3f},{max(u, SLOWEST_M_S):.3f}" for x, y, u in points]
    kept = [rows[0], *(b for a, b in pairwise(rows) if a.split(",")[:2] != b.split(",")[:2])]
    return "\n".join(["x,y,speed", *kept]) + "\n"


SHARE = 0.6  # Fraction of the time used for the fit; the remaining time is used for the evaluation
SMOOTHING_M = (0.05, 0.1, 0.2, 0.4)
"""Candidates for the RMS distance between the smooth path and the recorded track [m]. The first candidate with a path
that the machine can follow is used."""
LEVEL_M = 450.0  # Maximum absolute coordinate of a track above which the level ground of the scenario is enlarged [m]
OF_MAP = ("steer_offset_deg", "steer_scale", "steer_delay_s")
"""Names of the fitted quantities that the column map contains as `steer.offset`, `steer.scale` and `steer.delay_s`."""
MACHINE, SCENARIO, WAY = "machine.toml", "scenario.toml", "way.csv"
"""Names of the result files: machine, scenario and waypoints."""


class Twin(NamedTuple):
    """Digital twin of a machine, with the results of its evaluation."""

    name: str  # Names of the logs
    calibration: Calibration
    vehicle: dict[str, Quantity]  # Vehicle quantities by key
    keys: dict[str, TwinKey]  # Machine keys identified from the logs
    scenario: Scenario  # Scenario of the replay: the twin's machine on level ground
    fitted: tuple[FieldRecording, ...]  # Segments used in the fit, converted with the calibrated map
    held_out: ReplayResult
    texts: dict[str, str]  # Contents of the result files by name: machine, and scenario with waypoints if available
    identity: str

    @property
    def recorded(self) -> list[FieldRecording]:
        """Recorded segments that the fit did not use."""
        return [recording for recording, _ in self.held_out.pieces]

    @property
    def driven(self) -> list[Driven]:
        """Replays of the twin on the segments that the fit did not use."""
        return [driven for _, driven in self.held_out.pieces]

    @property
    def found(self) -> dict[str, Quantity]:
        """Estimated parameters of the sensors, keyed by map key, and of the vehicle, keyed by quantity name."""
        return {**self.calibration.found, **self.beyond_map}

    @property
    def beyond_map(self) -> dict[str, Quantity]:
        """Fitted vehicle quantities that are not part of the column map, by key."""
        return {key: each for key, each in self.vehicle.items() if key not in OF_MAP}


def twin(
    sources: Sequence[Source],
    log_map: LogMap | None,
    scenario: Scenario,
    share: float = SHARE,
    start_s: float = 0.0,
    end_s: float = inf,
) -> Twin:
    """Identify the digital twin of a machine from logs with a common map. `scenario` gives sizes and masses.

    Raises `FieldLogError` for unsuitable logs, `ScenarioError` if no map fits.
    """
    m, height = steered_map(sources[0], log_map), scenario.tractor.antenna_height_m
    name = ", ".join(map(source_name, sources))
    raw = read_pieces(sources, m, height, start_s, end_s, readings=True)
    first, _ = split_at(raw.kept, share)
    found = calibrate_log(raw._replace(kept=tuple(first)), m, scenario)
    vehicle = vehicle_quantities(found.fit, found.data.chassis)
    keys = twin_keys(found, vehicle, scenario)
    own = scenario.changed({key: each.value for key, each in keys.items()})
    whole = read_pieces(sources, found.calibrated, height, start_s, end_s).kept
    fitted, rest = split_at(whole, share)
    if not rest:
        raise FieldLogError(f"{name}: no data is left for the evaluation; use a longer log, or a smaller --share")
    play = keys.get(BACKLASH)
    judged = own if play is None else own.changed({BACKLASH: 0.0})
    held_out = replay_pieces([_behind(each, radians(play.value)) for each in rest] if play else rest, judged)
    texts = _texts(name, scenario, keys, way(whole, own.tractor.cg_to_rear_axle), twin_faults(found))
    identity = log_identity(scenario, sources, m, share=share, start_s=start_s, end_s=end_s)
    return Twin(name, found, vehicle, keys, own, tuple(fitted), held_out, texts, identity)


def _behind(recording: FieldRecording, backlash: float) -> FieldRecording:
    """Return the recording with the wheel angle instead of the sensor angle. The wheels lag the sensor by half the
    `backlash` [rad]."""
    assert recording.steer is not None
    t, sensor = recording.steer
    return recording._replace(steer=TimeSeries(t, wheel_angle(sensor, float(np.median(np.diff(t))), backlash, 0.0)))


def _texts(
    name: str,
    scenario: Scenario,
    keys: dict[str, TwinKey],
    points: Array | None,
    faults: Sequence[dict[str, Any]] = (),
) -> dict[str, str]:
    """Return the contents of the result files by name: the machine file and, if the machine can follow the waypoints
    `points`, a scenario with these waypoints."""
    notes = {key: each.note for key, each in keys.items()}
    title = f"Twin of {name}"
    head = f"Keys with a comment are from the log, with the 95 % interval; the others are from {scenario.machine!r}."
    texts = {MACHINE: annotated_toml(machine_data(scenario, keys, title), notes, head)}
    if points is None:
        return texts
    texts[WAY] = waypoint_text(points)
    for smoothing in SMOOTHING_M:
        texts[SCENARIO] = _scenario_text(title, points, smoothing, faults)
        if _drivable(texts):
            return texts
    return {MACHINE: texts[MACHINE]}


def _scenario_text(title: str, points: Array, smoothing: float, faults: Sequence[dict[str, Any]]) -> str:
    reach, speed = (float(np.abs(points[:, part]).max()) for part in (slice(2), 2))
    data: dict[str, Any] = {
        "title": f"{title}: longest recorded drive",
        "machine": MACHINE,
        "path": {
            "kind": "waypoints",
            "file": WAY,
            "corners": "spline",
            "smoothing_m": smoothing,
            "speed_m_s": round(speed, 2),
        },
        "guidance": {"kind": "pure_pursuit"},
    }
    if reach > LEVEL_M:
        data["terrain"] = {"kind": "flat", "half_size_m": float(ceil(reach) + 100)}
    if faults:
        data["fault"] = list(faults)
    head = "The recorded track with a guidance law of agrobot-mj; the law of the machine is unknown."
    return annotated_toml(data, {}, head)


def _drivable(texts: dict[str, str]) -> bool:
    """Return whether the scenario can be loaded. Loading fails if the path is too sharp for the machine."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        try:
            load_scenario(Path(folder) / SCENARIO)
        except ScenarioError:
            return False
    return True

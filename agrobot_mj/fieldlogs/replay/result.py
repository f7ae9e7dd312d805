"""A replay: read, drive, compare; and its files, `replay.json`, `.parquet`, `.png` and the scenario."""

import shutil
from math import degrees, inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from agrobot_mj.core.signals import Column
from agrobot_mj.fieldlogs.columns import Source
from agrobot_mj.fieldlogs.maps import LogMap
from agrobot_mj.fieldlogs.recording import FieldRecording, read_recording
from agrobot_mj.fieldlogs.replay.driving import By, Driven, drive
from agrobot_mj.fieldlogs.replay.figure import write_figure
from agrobot_mj.fieldlogs.replay.residuals import first_metres_end, metrics, position_errors, refined, start_pose
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.storage import atomic, write_json

COLUMNS = (
    Column("t", "s", "time since the log's first row"),
    Column("steer", "rad", "recorded wheel angle, left positive"),
    Column("steer_plant", "rad", "wheel angle of the plant"),
    Column("speed", "m/s", "recorded speed"),
    Column("speed_plant", "m/s", "speed of the plant"),
    Column("yaw_rate", "rad/s", "recorded yaw rate, left positive"),
    Column("yaw_rate_plant", "rad/s", "yaw rate of the plant"),
    Column("yaw_plant", "rad", "heading of the plant, from east, counter-clockwise, unwrapped"),
    Column("x", "m", "recorded point, east"),
    Column("y", "m", "recorded point, north"),
    Column("x_plant", "m", "the point on the plant, east"),
    Column("y_plant", "m", "the point on the plant, north"),
    Column("e_ahead", "m", "plant less recording, ahead along the plant's heading"),
    Column("e_left", "m", "plant less recording, to the left of the plant's heading"),
    Column("e_window", "m", "distance after the best rigid motion of each window of 10 s"),
)
"""Columns of `replay.parquet`: one row per tick of the plant; null where nothing was recorded within half a tick."""


class ReplayResult(NamedTuple):
    """A replay and its numbers."""

    recording: FieldRecording
    driven: Driven
    metrics: dict[str, Any]


def replay(
    source: Source,
    log_map: LogMap | None,
    scenario: Scenario,
    by: By | None = None,
    start_s: float = 0.0,
    end_s: float = inf,
) -> ReplayResult:
    """Drive the scenario's plant with a log; writes nothing. Raises `FieldLogError`, `ScenarioError`.

    Steers by the recorded angle where there is one, unless `by` says otherwise.
    """
    recording = read_recording(source, log_map, scenario.tractor.antenna_height_m).between(start_s, end_s)
    wheelbase, by = scenario.tractor.wheelbase_m, by or ("steer" if recording.steer is not None else "valve")
    pose = start_pose(recording, wheelbase)
    if recording.position is not None:
        first = recording._replace(end=max(first_metres_end(recording), recording.start + 1.0))
        pose = refined(pose, recording, drive(scenario, first, pose, by))
    driven = drive(scenario, recording, pose, by)
    numbers = {
        "log": recording.name,
        "plant": scenario.plant.kind,
        "steered_by": by,
        **metrics(recording, driven, wheelbase),
    }
    return ReplayResult(recording, driven, numbers)


def files_of_replay(scenario: Scenario) -> tuple[str, ...]:
    """Names of the files that `write_replay` writes."""
    return ("replay.json", "replay.parquet", "replay.png", "replay.toml", *scenario.portable()[1])


def write_replay(found: ReplayResult, scenario: Scenario, folder: Path) -> None:
    """Write the numbers, the signals, the figure, and the scenario with its data files into `folder`."""
    text, data_files = scenario.portable()
    with atomic(folder / "replay.parquet") as part:
        pq.write_table(signals(found.recording, found.driven), part, compression="zstd")
    write_json(folder / "replay.json", found.metrics)
    write_figure(found.recording, found.driven, folder / "replay.png")
    with atomic(folder / "replay.toml") as part:
        part.write_text(text, encoding="utf-8")
    for name, path in data_files.items():
        with atomic(folder / name) as part:
            shutil.copyfile(path, part)


def signals(recording: FieldRecording, driven: Driven) -> pa.Table:
    """The table of `COLUMNS`, with their units and descriptions."""
    t, n = driven.t, len(driven.t)
    tick = float(np.median(np.diff(t))) if n > 1 else 1.0

    def at_rows(times: pa.Array, values: Any) -> Any:
        """Values in the rows nearest to their times, NaN in the others."""
        column = np.full(n, np.nan)
        rows = np.rint((times - t[0]) / tick).astype(int)
        inside = (rows >= 0) & (rows < n)
        column[rows[inside]] = values[inside]
        return column

    none, fixes, rate = np.full(n, np.nan), recording.position, recording.yaw_rate
    at, off, window = position_errors(recording, driven)
    data = (
        t,
        recording.steer.at(t) if recording.steer else none,
        driven.steer,
        np.interp(t, recording.speed.t, recording.speed.value),
        driven.speed,
        at_rows(rate.t, rate.value) if rate else none,
        driven.yaw_rate,
        driven.yaw,
        *((at_rows(fixes.t, fixes.value[:, 0]), at_rows(fixes.t, fixes.value[:, 1])) if fixes else (none, none)),
        *driven.point.T,
        *((at_rows(at, off[:, 0]), at_rows(at, off[:, 1]), at_rows(at, window)) if len(at) else (none, none, none)),
    )
    fields = [pa.field(c.name, pa.float64(), metadata={"unit": c.unit, "description": c.description}) for c in COLUMNS]
    arrays = [pa.array(column, pa.float64(), from_pandas=True) for column in data]
    return pa.table(arrays, schema=pa.schema(fields))


def summary(found: ReplayResult) -> str:
    """The numbers in a few lines."""
    m = found.metrics
    lines = [f"{m['log']}: {m['duration_s']:.1f} s, {m['way_m']:.0f} m on the {m['plant']} plant, by {m['steered_by']}"]
    if rate := m["yaw_rate"]:
        slipless = rate["kinematic_rms_without_bias"]
        beside = f" (without slip {degrees(slipless):.3f})" if slipless is not None else ""
        lines.append(
            f"yaw rate ({rate['source']}): residual {degrees(rate['rms_without_bias']):.3f} deg/s rms{beside}, "
            f"bias {degrees(rate['bias']):+.3f} deg/s, recorded {rate['lag_s']:+.3f} s after the plant"
        )
        if rate["explained"] is not None and rate["explained"] < 0:
            lines.append(
                "The plant's yaw rate explains nothing of the recorded one: check sign (positive) and unit of [steer], "
                "[speed] and [yaw_rate] in the map"
            )
    if place := m["position"]:
        shape = "-" if place["windows_rms"] is None else f"{place['windows_rms']:.3f} m"
        lines.append(
            f"position: {shape} rms in windows of {place['window_s']:g} s; open loop {place['rms']:.2f} m rms, "
            f"{place['at_the_end']:.2f} m at the end"
        )
    return "\n".join(lines)

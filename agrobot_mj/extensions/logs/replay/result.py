"""Replay of logs: reading, simulation and comparison. The results are `replay.json`, `replay.parquet`, a figure and the
scenario."""

import shutil
from collections.abc import Sequence
from math import ceil, inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLUE, DARK_GREY, VERMILION
from agrobot_mj.core.signals import Column
from agrobot_mj.core.table_columns import Source
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.pieces import read_pieces
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.driving import By, Driven, drive
from agrobot_mj.extensions.logs.replay.residuals import (
    Replayed,
    first_metres_end,
    metrics,
    position_errors,
    refine_pose,
    start_pose,
)
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import atomic, write_text
from agrobot_mj.studies.style import PANEL_WIDTH_IN, write_figure

COLUMNS = (
    Column("piece", "-", "number of the segment, from 0"),
    Column("t", "s", "time since the first row of the log"),
    Column("steer", "rad", "recorded wheel angle, left positive"),
    Column("steer_plant", "rad", "wheel angle of the plant"),
    Column("speed", "m/s", "recorded speed"),
    Column("speed_plant", "m/s", "speed of the plant"),
    Column("yaw_rate", "rad/s", "recorded yaw rate, left positive"),
    Column("yaw_rate_plant", "rad/s", "yaw rate of the plant"),
    Column("yaw_plant", "rad", "heading of the plant, from east, counter-clockwise, unwrapped"),
    Column("x", "m", "recorded point, east"),
    Column("y", "m", "recorded point, north"),
    Column("x_plant", "m", "same point on the plant, east"),
    Column("y_plant", "m", "same point on the plant, north"),
    Column("e_ahead", "m", "plant minus recording, ahead along the heading of the plant"),
    Column("e_left", "m", "plant minus recording, to the left of the heading of the plant"),
    Column("e_window", "m", "distance after the best rigid alignment of each window of 10 s"),
)
"""Columns of `replay.parquet`, with one row per tick. Recorded values are null without a sample within half a tick."""


class ReplayResult(NamedTuple):
    """Replayed segments with their metrics."""

    pieces: tuple[Replayed, ...]
    metrics: dict[str, Any]
    notes: tuple[str, ...]  # Notes about the used and omitted parts of the logs


def replay(
    source: Source | Sequence[Source],
    log_map: LogMap | None,
    scenario: Scenario,
    by: By | None = None,
    start_s: float = 0.0,
    end_s: float = inf,
) -> ReplayResult:
    """Replay logs on the plant of a scenario without writing files. Raises `FieldLogError` for unsuitable logs.

    By default, `by` is the recorded angle if available, otherwise the voltage.
    """
    cut = read_pieces(source, log_map, scenario.tractor.antenna_height_m, start_s, end_s)
    return replay_pieces(cut.kept, scenario, by, cut.notes)


def replay_pieces(
    recordings: Sequence[FieldRecording], scenario: Scenario, by: By | None = None, notes: tuple[str, ...] = ()
) -> ReplayResult:
    """Replay segments on the plant of a scenario."""
    by = by or ("steer" if recordings[0].steer is not None else "valve")
    scenario = on_wide_ground(scenario, max(map(reach, recordings)))
    driven = tuple((each, _replay_segment(each, scenario, by)) for each in recordings)
    wheelbase = scenario.tractor.wheelbase_m
    numbers = {
        "log": ", ".join(dict.fromkeys(each.name for each in recordings)),
        "plant": scenario.plant.kind,
        "steered_by": by,
        **metrics(driven, wheelbase),
    }
    if len(driven) > 1:
        numbers["pieces"] = [{"log": each[0].name, **metrics([each], wheelbase)} for each in driven]
    return ReplayResult(driven, numbers, notes)


def on_wide_ground(scenario: Scenario, reach: float) -> Scenario:
    """Return the scenario with flat ground that extends more than `reach` [m] from the origin. Other terrain is
    unchanged."""
    if scenario.terrain.kind != "flat" or min(scenario.terrain.half_sizes) > reach:
        return scenario
    return scenario.changed({"terrain.half_size_m": float(ceil(reach) + 100)})


def reach(recording: FieldRecording) -> float:
    """Return the maximum absolute coordinate of a segment [m] or, without positions, maximum speed times duration."""
    if recording.position is not None:
        return float(np.abs(recording.position.value).max())
    return float(np.abs(recording.speed.value).max()) * (recording.end - recording.start)


def _replay_segment(recording: FieldRecording, scenario: Scenario, by: By) -> Driven:
    """Replay a segment. If positions are recorded, the initial pose is fitted to the first metres of the positions."""
    pose = start_pose(recording, scenario.tractor.wheelbase_m)
    if recording.position is not None:
        first = recording._replace(end=max(first_metres_end(recording), recording.start + 1.0))
        pose = refine_pose(pose, recording, drive(scenario, first, pose, by))
    return drive(scenario, recording, pose, by)


def files_of_replay(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the files that `write_replay` writes for a scenario."""
    return ("replay.parquet", "replay.png", "replay.toml", *scenario.portable()[1])


def write_replay(found: ReplayResult, scenario: Scenario, folder: Path) -> None:
    """Write signals, figure, and the scenario with its data files to `folder`."""
    text, data_files = scenario.portable()
    text = f"# identity {found.metrics.get('identity', '')}\n{text}"
    with atomic(folder / "replay.parquet") as part:
        pq.write_table(signals(found.pieces), part, compression="zstd")
    write_figure(folder / "replay.png", figure, found.pieces)
    write_text(folder / "replay.toml", text)
    for name, path in data_files.items():
        with atomic(folder / name) as part:
            shutil.copyfile(path, part)


def signals(pieces: Sequence[Replayed]) -> pa.Table:
    """Return the signals of replayed segments as a table with the columns `COLUMNS`."""
    return pa.concat_tables([_signals(k, *each) for k, each in enumerate(pieces)])


def _signals(number: int, recording: FieldRecording, driven: Driven) -> pa.Table:
    t, n = driven.t, len(driven.t)
    tick = float(np.median(np.diff(t))) if n > 1 else 1.0

    def at_rows(times: pa.Array, values: Any) -> Any:
        """Return a column with each value in the row nearest to the time of the value. Other rows contain NaN."""
        column = np.full(n, np.nan)
        rows = np.rint((times - t[0]) / tick).astype(int)
        inside = (rows >= 0) & (rows < n)
        column[rows[inside]] = values[inside]
        return column

    none, fixes, rate = np.full(n, np.nan), recording.position, recording.yaw_rate
    at, off, window = position_errors(recording, driven)
    data = (
        np.full(n, float(number)),
        t,
        recording.steer.at(t) if recording.steer else none,
        driven.steer,
        np.interp(t, *recording.speed),
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


def figure(pieces: Sequence[Replayed]) -> Figure:
    """Return a figure with four panels: track, yaw rates, yaw-rate residuals and position residuals."""
    drawn = Figure(figsize=(2 * PANEL_WIDTH_IN, 5.0), layout="constrained")
    (way, rate), (place, rest) = drawn.subplots(2, 2)
    for recording, driven in pieces:
        _way(way, recording, driven)
        _rates(rate, rest, recording, driven)
        _place(place, recording, driven)
    _titles(way, rate, rest, place)
    for axes in (way, rate, place):
        _legend(axes)
    return drawn


def _way(axes: Any, recording: FieldRecording, driven: Driven) -> None:
    if recording.position is not None:
        axes.plot(*recording.position.value.T, ".", color=DARK_GREY, markersize=1.5, label="recorded")
    axes.plot(*driven.point.T, color=BLUE, label="plant")


def _rates(rate: Any, rest: Any, recording: FieldRecording, driven: Driven) -> None:
    rate.plot(driven.t, np.degrees(driven.yaw_rate), color=BLUE, label="plant", zorder=3)
    if recording.yaw_rate is not None:
        t, value = recording.yaw_rate.between(driven.t[0], driven.t[-1])
        rate.plot(t, np.degrees(value), color=DARK_GREY, label=f"recorded ({recording.yaw_rate_source})")
        rest.plot(t, np.degrees(np.interp(t, driven.t, driven.yaw_rate) - value), color=VERMILION)


def _place(axes: Any, recording: FieldRecording, driven: Driven) -> None:
    t, off, window = position_errors(recording, driven)
    if len(t):
        axes.plot(t, off[:, 0], color=DARK_GREY, label="ahead")
        axes.plot(t, off[:, 1], color=BLUE, label="left")
        axes.plot(t, window, color=VERMILION, label="windows of 10 s")


def _titles(way: Any, rate: Any, rest: Any, place: Any) -> None:
    way.set_aspect("equal", adjustable="datalim")
    way.set(xlabel="East [m]", ylabel="North [m]", title="Track of the recorded point")
    rate.set(xlabel="Time [s]", ylabel="Yaw rate [deg/s]", title="Yaw rate")
    rest.set(xlabel="Time [s]", ylabel="Plant minus recording [deg/s]", title="Residual of the yaw rate")
    place.set(xlabel="Time [s]", ylabel="Plant minus recording [m]", title="Residual of the position")


def _legend(axes: Any) -> None:
    found = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if found:
        axes.legend(found.values(), found.keys())

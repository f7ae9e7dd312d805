"""Several runs in one recording: tractors of different colours on the same ground, and plots with one line a run.

Written at the end from the logs. Poses come ten times a second, signals at every tick, as far as each run went.
"""

import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from agrobot_mj.core.signals import Array
from agrobot_mj.core.version import __version__
from agrobot_mj.metrics.crosstrack import cross_track
from agrobot_mj.plants.scene import Geom, Scene
from agrobot_mj.recording.blueprint import information, panels, plot_view, scenes, tiled, whole_run
from agrobot_mj.recording.info import compared, resolved
from agrobot_mj.recording.plots.axes import value_range
from agrobot_mj.recording.plots.signals import UNITS, Plot
from agrobot_mj.recording.transport.sink import Sink
from agrobot_mj.recording.transport.timeline import APPLICATION, TIMELINE, nanoseconds
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.recording.world.scene import reference_line, send_scene, shapes
from agrobot_mj.recording.world.tracks import piece_ends, strips
from agrobot_mj.simulation.log import Log

COLOURS = (0xE69F00FF, 0x56B4E9FF, 0x009E73FF, 0xCC79A7FF, 0xD55E00FF, 0xF0E442FF, 0x3A6FD8FF, 0xBBBBBBFF)
"""One a run, in turn."""
POSE_TICKS = 2
BESIDE = 3
"""Plots beside the scene."""
TRACK_LIFT_M, TRACK_WIDTH = 0.04, 1.5
PAINTED = 0.12
"""Parts whose brightest and darkest channels differ by more are painted in the colour of the run, others stay grey."""
PLOTS = (
    ("lateral", "Lateral error to the moving reference", "m", "e_lateral"),
    ("cross_track", "Cross-track error", "m", "cross_track"),
    ("command", "Steering command", "deg", "steer_ref"),
    ("network", "Network's part of the command, -tau_n", "deg", "network"),
    ("yaw_rate", "Yaw-rate error", "deg/s", "e_yaw_rate"),
    ("speed", "Speed", "m/s", "speed"),
)
"""Path, title, unit and column of the log, or of `_signals`."""


class RecordedRun(NamedTuple):
    """One run of a comparison."""

    name: str
    """As the legend has it: plant and controller."""
    log: Log
    colour: int
    """0xRRGGBBAA."""

    @property
    def place(self) -> str:
        """Where the tractor is in the recording."""
        return f"world/{self.name}"


def write_comparison(named: Sequence[tuple[str, Log]], path: Path) -> None:
    """Record the runs `named` plant-controller on the ground of the first into `path`. Raises OSError."""
    runs = [RecordedRun(name, log, COLOURS[i % len(COLOURS)]) for i, (name, log) in enumerate(named)]
    scenario = runs[0].log.scenario
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{scenario.name}-compare-{uuid.uuid4()}")
    sink = Sink(stream, path)
    stream.send_recording_name(f"{scenario.name}: {len(runs)} runs")
    about = rr.AnyValues(version=__version__, hash=scenario.hash8, seed=scenario.seed, name=scenario.name)
    stream.send_property("scenario", about)
    ground = scenario.terrain.ground()
    reference = max((reference_line(run.log.scenario, ground) for run in runs), key=len)
    send_scene(stream, Scene((), ()), ground, reference)
    shown = [plot for run in runs for plot in _send(stream, run)]
    rows = [(run.name, run.colour, run.log) for run in runs]
    for entity, text in (("info", compared(scenario, rows)), ("scenario", resolved(scenario))):
        stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
    stream.send_blueprint(_blueprint(runs, {plot.path.split("/")[1]: plot for plot in shown}, reference))
    sink.close()


def _send(stream: rr.RecordingStream, run: RecordedRun) -> list[Plot]:
    """Everything of one run; returns its plots."""
    log = run.log
    there = _sound(log)
    times, poses = nanoseconds(log.column("t")), log.poses[:there:POSE_TICKS]
    column = rr.TimeColumn(TIMELINE, duration=times[:there:POSE_TICKS])
    for i, body in enumerate(log.scene.bodies):
        geoms = [_painted(geom, run.colour) for geom in log.scene.geoms if geom.body == body]
        for kind, shape in shapes(geoms).items():
            stream.log(f"{run.place}/{body}/{kind}", shape, static=True)
        moved = rr.Transform3D.columns(translation=poses[:, i, :3], quaternion=poses[:, i, [4, 5, 6, 3]])
        stream.send_columns(f"{run.place}/{body}", [column], moved)
    _send_track(stream, run, times[:there])
    return _send_plots(stream, run, rr.TimeColumn(TIMELINE, duration=times))


def _sound(log: Log) -> int:
    """How many rows come before the first without a pose."""
    broken = np.flatnonzero(~np.isfinite(log.poses.reshape(len(log.poses), -1)).all(axis=1))
    return int(broken[0]) if broken.size else len(log.poses)


def _send_track(
    stream: rr.RecordingStream, run: RecordedRun, times: "np.ndarray[tuple[int], np.dtype[np.timedelta64]]"
) -> None:
    points = np.column_stack([run.log.column("x"), run.log.column("y")])[: len(times)]
    if not len(points):
        return
    laid = on_ground(run.log.scenario.terrain.ground(), points, TRACK_LIFT_M)
    ends = piece_ends(len(points))
    column = rr.TimeColumn(TIMELINE, duration=times[ends - 1])
    pieces = rr.LineStrips3D.columns(strips=strips(laid, np.append(0, ends[:-1] - 1), ends))
    stream.send_columns(f"world/tracks/{run.name}", [column], pieces)
    style = rr.LineStrips3D.from_fields(colors=run.colour, radii=rr.Radius.ui_points(TRACK_WIDTH))
    stream.log(f"world/tracks/{run.name}", style, static=True)


def _send_plots(stream: rr.RecordingStream, run: RecordedRun, column: rr.TimeColumn) -> list[Plot]:
    """Each signal of the run under the plot that it shares with the other runs."""
    shown = []
    for path, title, unit, name in PLOTS:
        values = _signal(run.log, name)
        if values.any():
            scalars = rr.Scalars.columns(scalars=values * UNITS[unit])
            stream.send_columns(f"plots/{path}/{run.name}", [column], scalars)
            style = rr.SeriesLines(
                names=run.name,
                colors=run.colour,
                widths=1.5,
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
            )
            stream.log(f"plots/{path}/{run.name}", style, static=True)
            shown.append(Plot(f"compared/{path}", title, unit, ()))
    return shown


def _values(run: RecordedRun, path: str) -> Array:
    """What the plot `path` shows of a run, in its unit."""
    ((unit, name),) = [(unit, name) for there, _, unit, name in PLOTS if there == path]
    return _signal(run.log, name) * UNITS[unit]


def _signal(log: Log, name: str) -> Array:
    if name == "cross_track":
        return cross_track(log.scenario.path, log.column("t"), log.column("x"), log.column("y"))
    return -log.column("tau_n") if name == "network" else log.column(name)


def _painted(geom: Geom, colour: int) -> Geom:
    """The geom in the run's colour if it is of the body's paint; tyres, metal and glass stay."""
    channels = np.array(geom.rgba[:3])
    if np.ptp(channels) < PAINTED:
        return geom
    r, g, b = ((colour >> shift & 255) / 255 for shift in (24, 16, 8))
    return geom._replace(rgba=(r, g, b, geom.rgba[3]))


def _blueprint(runs: Sequence[RecordedRun], plots: dict[str, Plot], reference: Array) -> rrb.Blueprint:
    """Scene and plots side by side, then the same text tab as other recordings have."""
    longest = max((run.log for run in runs), key=lambda log: log.rows.filled)
    axis = whole_run(float(longest.column("t")[-1]))
    followed = f"{runs[-1].place}/chassis/boxes"
    growing = [f"world/tracks/{run.name}" for run in runs]
    left = scenes(reference, float(longest.column("yaw")[0]), followed, growing)

    def views(rows: int) -> list[rrb.View]:
        ranges = {path: value_range(np.concatenate([_values(run, path) for run in runs])) for path in plots}
        return [plot_view(plot, f"plots/{path}", axis, ranges[path], rows) for path, plot in plots.items()]

    return rrb.Blueprint(
        rrb.Tabs(
            rrb.Horizontal(left, rrb.Vertical(*views(BESIDE)[:BESIDE]), column_shares=[3, 2], name="Drive"),
            tiled(views(BESIDE), "Control", 2),
            information(),
        ),
        *panels(),
        auto_views=False,
    )

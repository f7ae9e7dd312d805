"""Recording of several runs: tractors of different colours on the same ground, and plots with one line per run.

The camera follows the tractor of the last run, which is opaque; the other tractors are translucent. A name label is
above each tractor. Tracks are stacked, with narrower tracks on top, so that all colours are visible. The recording is
written from the logs: poses ten times per second and signals at every tick, up to the end of each run.
"""

import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from agrobot_mj.core.labels import safe_names
from agrobot_mj.core.palette import GREEN, LIGHT_GREY, ORANGE, PINK, ROYAL_BLUE, SKY_BLUE, VERMILION, YELLOW, rgba
from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.crosstrack import cross_track
from agrobot_mj.plants.scene import Geom, Scene
from agrobot_mj.recording.blueprint import align_plots, layout, plot_view, scenes, stack_views, tile_views
from agrobot_mj.recording.info import comparison_text, describe, tell
from agrobot_mj.recording.plots.axes import Frame, frame
from agrobot_mj.recording.plots.catalogue import COMPARED, DIFFERENCE, NEGATED, Plot, Series
from agrobot_mj.recording.plots.signals import MEAN_S, noisy_means, send_means, style
from agrobot_mj.recording.transport.sink import Sink, is_enabled
from agrobot_mj.recording.transport.timeline import APPLICATION, Times, nanoseconds, send
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.recording.world.motion import sound_rows
from agrobot_mj.recording.world.names import ENTITY as NAMES
from agrobot_mj.recording.world.names import move_points, name_points
from agrobot_mj.recording.world.scene import camera_target, reference_line, send_scene, shapes
from agrobot_mj.recording.world.tracks import piece_ends, strips
from agrobot_mj.simulation.log import Log

PALETTE = (ORANGE, SKY_BLUE, GREEN, PINK, VERMILION, YELLOW, ROYAL_BLUE, LIGHT_GREY)
POSE_TICKS = 2  # Number of ticks between recorded poses
BESIDE = 3  # Maximum number of plots next to the scene
TRACK_LIFT_M, TRACK_STEP_M = 0.03, 0.08
"""Height of the lowest track above the ground, and vertical distance between stacked tracks [m]."""
TRACK_WIDTH, TRACK_WIDER = 1.1, 0.6
"""Half width of the uppermost track [pixels], and increase of the half width for each track below [pixels]."""
PAINTED = 0.12
"""Minimum difference between the maximum and minimum colour channel (0-1) of geoms drawn in the colour of the run.

Geoms with a smaller difference are grey and keep their colour.
"""
GHOST = 0.22  # Opacity of the translucent tractors [-]
NAME_M, NAME_STEP_M = 0.2, 0.2  # Height of the lowest name above the default tractor, and distance between names [m]


class RecordedRun(NamedTuple):
    """Run of a comparison, with its colour and the position of its track in the stack of tracks."""

    name: str
    entity: str
    log: Log
    colour: int  # Colour as 0xRRGGBBAA
    below: int  # Number of tracks drawn below the track of this run
    above: int  # Number of tracks drawn above the track of this run, or 0 for the run with the opaque tractor

    values: dict[str, Array]
    """Plotted signals in the units of their plots, by the path of the plot in `COMPARED`."""

    @property
    def place(self) -> str:
        """Rerun entity path of the tractor of this run."""
        return f"world/{self.entity}"


def write_comparison(named: Sequence[tuple[str, Log]], path: Path) -> None:
    """Write a recording of several runs, given as pairs (name, log), to `path`. Raises OSError if writing fails.

    The ground is the ground of the first run. No recording is written if Rerun is disabled.
    """
    last = len(named) - 1
    entities = safe_names(name for name, _ in named)
    runs = [
        RecordedRun(name, entity, log, rgba(PALETTE[i % len(PALETTE)]), i, last - i, _values(log))
        for i, ((name, log), entity) in enumerate(zip(named, entities, strict=True))
    ]
    scenario = runs[0].log.scenario
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{scenario.name}-compare-{uuid.uuid4()}")
    if not is_enabled(stream, path):
        return
    sink = Sink(stream, path)
    describe(stream, f"{scenario.name}: {len(runs)} runs", scenario)
    tell(stream, comparison_text(scenario, [(run.name, run.colour, run.log) for run in runs]))
    ground = scenario.terrain.ground()
    reference = max((reference_line(run.log.scenario, ground) for run in runs), key=len)
    send_scene(stream, Scene((), ()), ground, reference)
    for run in runs:
        _send(stream, run)
    _add_differences(runs)
    plots = [each for plot in COMPARED for each in _send_plot(stream, plot, runs)]
    stream.send_blueprint(_blueprint(runs, plots, reference))
    sink.close()


def _values(log: Log) -> dict[str, Array]:
    found = {}
    for plot in COMPARED:
        column = plot.series[0].column
        if column == DIFFERENCE:
            continue
        if column == "cross_track":
            values = cross_track(log.scenario.path, log.column("t"), log.column("x"), log.column("y"))
        else:
            values = log.column(column)
        if np.nan_to_num(values).any():
            found[plot.path] = values * (-1 if column in NEGATED else 1) * plot.factor
    return found


def _add_differences(runs: Sequence[RecordedRun]) -> None:
    first = runs[0].values.get("cross_track")
    for run in runs[1:]:
        own = run.values.get("cross_track")
        if first is not None and own is not None and run.log.scenario.path == runs[0].log.scenario.path:
            both = min(len(own), len(first))
            with np.errstate(invalid="ignore", over="ignore"):  # diverged runs may contain infinite values
                run.values[DIFFERENCE] = own[:both] - first[:both]


def _send(stream: rr.RecordingStream, run: RecordedRun) -> None:
    log = run.log
    times = nanoseconds(log.column("t"))
    there = sound_rows(log.poses, log.column("x"), log.column("y"))
    poses = log.poses[:there:POSE_TICKS]
    for i, body in enumerate(log.scene.bodies):
        geoms = [_paint_geom(geom, run) for geom in log.scene.geoms if geom.body == body]
        for kind, shape in shapes(geoms).items():
            stream.log(f"{run.place}/{body}/{kind}", shape, static=True)
        if there:
            moved = rr.Transform3D.columns(translation=poses[:, i, :3], quaternion=poses[:, i, [4, 5, 6, 3]])
            send(stream, f"{run.place}/{body}", times[:there:POSE_TICKS], moved)
    if there:
        _send_track(stream, run, times[:there])
        _send_name(stream, run, times[:there:POSE_TICKS], poses[:, 0, :3])


def _send_name(stream: rr.RecordingStream, run: RecordedRun, times: Times, places: Array) -> None:
    scene, size, entity = run.log.scene, run.log.scenario.tractor.size, f"{NAMES}/{run.entity}"
    top = max(geom.pos[2] + min(geom.size) for geom in scene.geoms if geom.body == scene.bodies[0])
    name_points(stream, entity, [run.name], [run.colour])
    above = np.array([0.0, 0.0, top + size * (NAME_M + NAME_STEP_M * run.below)])
    move_points(stream, entity, times, places + above)


def _send_track(stream: rr.RecordingStream, run: RecordedRun, times: Times) -> None:
    points = np.column_stack([run.log.column("x"), run.log.column("y")])[: len(times)]
    lift, width = TRACK_LIFT_M + TRACK_STEP_M * run.below, TRACK_WIDTH + TRACK_WIDER * run.above
    laid = on_ground(run.log.scenario.terrain.ground(), points, lift)
    ends = piece_ends(len(points))
    pieces = rr.LineStrips3D.columns(strips=strips(laid, np.append(0, ends[:-1] - 1), ends))
    send(stream, f"world/tracks/{run.entity}", times[ends - 1], pieces)
    style = rr.LineStrips3D.from_fields(colors=run.colour, radii=rr.Radius.ui_points(width))
    stream.log(f"world/tracks/{run.entity}", style, static=True)


def _send_plot(stream: rr.RecordingStream, plot: Plot, runs: Sequence[RecordedRun]) -> list[tuple[Plot, Frame]]:
    """Send one line of a plot for each run; return the plot with its axes, or an empty list if no run has the
    signal."""
    having = [run for run in runs if plot.path in run.values]
    if not having:
        return []
    t = max((run.log.column("t") for run in having), key=len)
    numbers = np.full((len(t), len(having)), np.nan)
    for k, run in enumerate(having):
        numbers[: len(run.values[plot.path]), k] = run.values[plot.path]
    numbers[~np.isfinite(numbers)] = np.nan
    means = noisy_means(numbers)
    for k, run in enumerate(having):
        line = Plot(f"{plot.path}/{run.entity}", "", plot.unit, (Series(run.name, "", run.colour),))
        there = np.isfinite(numbers[:, k])
        stream.log(line.entity, style(line), static=True)
        send(stream, line.entity, nanoseconds(t[there]), rr.Scalars.columns(scalars=numbers[there, k]))
        if means is not None:
            send_means(stream, line, t, means[:, [k]])
    lines = tuple(Series(run.name, plot.series[0].column, run.colour) for run in having)
    title = f"{plot.title} {runs[0].name}" if plot.path == DIFFERENCE else plot.title
    shown = plot._replace(series=lines, title=title)
    return [(shown, frame(t, numbers, shown, beside=True)._replace(mean_s=None if means is None else MEAN_S))]


def _paint_geom(geom: Geom, run: RecordedRun) -> Geom:
    """Return a geom in the colour of its run. The colour of grey geoms (tyres, metal, glass) is unchanged."""
    opacity = GHOST if run.above else geom.rgba[3]
    channels = np.array(geom.rgba[:3])
    if np.ptp(channels) < PAINTED:
        return geom._replace(rgba=(*geom.rgba[:3], opacity))
    r, g, b = ((run.colour >> shift & 255) / 255 for shift in (24, 16, 8))
    return geom._replace(rgba=(r, g, b, opacity))


def _blueprint(runs: Sequence[RecordedRun], plots: Sequence[tuple[Plot, Frame]], reference: Array) -> rrb.Blueprint:
    longest = max((run.log for run in runs), key=lambda log: log.rows.filled)
    t = longest.column("t")
    end_s = float(t[-1]) if len(t) else 0.0
    yaw = longest.column("yaw")[:1]
    heading = float(yaw[0]) if np.isfinite(yaw).any() else 0.0
    growing = [f"world/tracks/{run.entity}" for run in runs]
    size, seen = (
        max(run.log.scenario.tractor.size for run in runs),
        f"{runs[-1].place}/{camera_target(runs[-1].log.scene)}",
    )
    left = scenes(reference, heading, size, seen, growing)
    tab = [plot_view(plot, end_s, framed, 2 / (len(plots) + 1)) for plot, framed in plots]
    return layout(left, stack_views(align_plots(plots[:BESIDE]), end_s), tile_views(tab, "Control", 2))

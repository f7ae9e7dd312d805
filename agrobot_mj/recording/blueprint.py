"""Layout of the Rerun viewer for a recording: tabs by subject, time axes of the complete run, and a following
camera."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from agrobot_mj.core.geometry import from_heading
from agrobot_mj.core.signals import Array
from agrobot_mj.recording.plots.axes import Frame, most_steps, pixels, readable, time_end
from agrobot_mj.recording.plots.catalogue import DRIVE, Plot
from agrobot_mj.recording.plots.network import Map
from agrobot_mj.recording.transport.timeline import TIMELINE

FOLLOWED = "world/bodies/chassis/boxes"  # Entity that the following camera tracks. The entity must have geometry.
GROWING = (*(f"world/tracks/{track}" for track in ("true", "estimated", "gnss", "tyres")), "world/events")
"""Entities whose content accumulates during a run. The views show all content up to the current time."""
SKY, BEYOND = 0xB9CDDBFF, 0x50563FFF
"""Background colours 0xRRGGBBAA of the view that follows the tractor and of the top view."""
SO_FAR = rrb.VisibleTimeRanges(
    timeline=TIMELINE, start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.cursor_relative()
)
TABS = {
    "Control": ("yaw_rate/", "control/", "steering/", "speed/"),
    "Tyres": ("tyres/",),
    "Estimator": ("estimator/",),
    "Network": ("network/",),
    "More": ("reported/",),
}
"""Path prefixes of the plots on each tab. The scene has a separate tab, and tabs without plots are omitted."""
COMPANIONS = {"Tyres": ("attitude",), "Network": ("control/command",)}
"""Path prefixes of additional plots on a tab, which are shown only if the tab has plots listed in `TABS`."""
FOLLOW_FROM = (-3.4, -2.6, 2.3)
"""Initial position of the camera that follows the tractor, relative to a tractor of default size [m]: forward, left and
up."""
LOOK_AT = (0.5, 0.0, 0.6)
"""Initial target point of the camera that follows the tractor, relative to a tractor of default size [m]: forward, left
and up."""
VIEWED = (2.2, 0.85)
"""Width and height of the ground visible in the top view, divided by the camera height [-], measured in the viewer."""
TILT = 0.1
"""Southward offset of the top-view camera divided by its height [-]. The offset keeps north at the top."""
COLUMNS, MOST_PLOTS = 3, 12
"""Number of plot columns and maximum number of plots on a tab. Additional plots are on further tabs."""
LANE, LANES_BESIDES, MOST_LANES = 0.053, 0.075, 0.5
"""Fractions of the tab height [-]: height of one lane in the state view, height of the view without lanes, and maximum
height of the view."""
NAMES = "world/names"  # Entity of the name labels in 3D. The top view hides them, because they would overlap.


class Shown(NamedTuple):
    """Plots, heat maps and view parameters that determine the viewer layout of a recording."""

    plots: Sequence[Plot]
    maps: Sequence[Map] = ()  # Heat maps of the neural network
    lanes: int = 3
    frames: Mapping[str, Frame] = MappingProxyType({})
    """Axes and legends of plots by plot path. The viewer chooses the axes of plots without an entry."""
    outcome: str = ""
    size: float = 1.0  # Size of the tractor, including drawn implements, divided by the size of the default tractor [-]
    followed: str = FOLLOWED


def blueprint(shown: Shown, places: Array, yaw: float, end_s: float) -> rrb.Blueprint:
    """Return the viewer layout of a run that ends at `end_s` [s].

    The top view contains all points `places` (n, 3) [m]. The tractor starts at the first point with heading `yaw`
    [rad].
    """

    def framed(starts: tuple[str, ...]) -> list[tuple[Plot, Frame]]:
        return [(plot, shown.frames.get(plot.path, Frame())) for plot in _of(shown.plots, starts)]

    def tabs(name: str) -> list[rrb.Vertical]:
        starts = (*TABS[name], *COMPANIONS.get(name, ()))
        plots, maps = framed(starts), [one for one in shown.maps if one.entity.startswith(starts)]
        content = [*plots, *maps]
        parts = np.array_split(np.arange(len(content)), -(-len(content) // MOST_PLOTS))
        names = [name, *(f"{name} {number}" for number in range(2, len(parts) + 1))]
        return [tile_views(views([content[k] for k in part]), each) for each, part in zip(names, parts, strict=True)]

    def views(content: Sequence[tuple[Plot, Frame] | Map]) -> list[rrb.View]:
        share = 1 / -(-len(content) // COLUMNS)
        return [_map(one) if isinstance(one, Map) else plot_view(one[0], end_s, one[1], share) for one in content]

    return layout(
        scenes(places, yaw, shown.size, shown.followed),
        _beside(framed(DRIVE), shown, end_s),
        *(tab for name, starts in TABS.items() if _of(shown.plots, starts) for tab in tabs(name)),
    )


def layout(scene: rrb.Vertical, beside: rrb.Vertical, *tabs: rrb.Vertical) -> rrb.Blueprint:
    """Return a viewer layout: scene and plots `beside` on the first tab, further `tabs`, and a tab with texts."""
    drive = rrb.Horizontal(scene, beside, column_shares=[3, 2], name="Drive")
    told = rrb.TextDocumentView(origin="info", name="Run")
    words = rrb.Horizontal(told, rrb.TextDocumentView(origin="scenario", name="Scenario, resolved"), name="Info")
    return rrb.Blueprint(
        rrb.Tabs(drive, *tabs, words),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _of(plots: Sequence[Plot], starts: tuple[str, ...]) -> list[Plot]:
    return [plot for plot in plots if plot.path.startswith(starts)]


def stack_views(
    plots: Sequence[tuple[Plot, Frame]], end_s: float, below: Sequence[tuple[rrb.View, float]] = ()
) -> rrb.Vertical:
    """Return a column of plots above the views `below`. Each item of `below` is a view and its fraction of the
    height."""
    heights = np.array([pixels(frame.values) for _, frame in plots])
    shares = (1 - sum(share for _, share in below)) * heights / heights.sum()
    views = [plot_view(plot, end_s, frame, share) for (plot, frame), share in zip(plots, shares, strict=True)]
    rows = [*views, *(view for view, _ in below)]
    return rrb.Vertical(*rows, row_shares=[*shares.tolist(), *(share for _, share in below)])


def _beside(plots: Sequence[tuple[Plot, Frame]], shown: Shown, end_s: float) -> rrb.Vertical:
    plots = align_plots(plots)
    room = plots[0][1].room if plots else 0.0
    name = f"States; the run: {shown.outcome.replace('_', ' ')}" if shown.outcome else "States"
    states = rrb.StateTimelineView(origin="states", name=name, time_view=whole_run(end_s, room))
    return stack_views(plots, end_s, [(states, min(LANES_BESIDES + LANE * shown.lanes, MOST_LANES))])


def align_plots(plots: Sequence[tuple[Plot, Frame]]) -> list[tuple[Plot, Frame]]:
    """Return the plots with equal time axes: if one plot reserves space for its legend, all plots reserve this
    space."""
    room = max((frame.room for _, frame in plots), default=0.0)
    if not room:
        return list(plots)
    return [(plot, frame._replace(room=room, legend=rrb.Corner2D.RightTop)) for plot, frame in plots]


def tile_views(views: Sequence[rrb.View], name: str, columns: int = COLUMNS) -> rrb.Vertical:
    """Return a grid of views with at most `columns` columns and without empty cells."""
    rows = np.array_split(np.arange(len(views)), -(-len(views) // columns))
    return rrb.Vertical(*(rrb.Horizontal(*(views[i] for i in row)) for row in rows), name=name)


def scenes(
    places: Array, yaw: float, size: float = 1.0, followed: str = FOLLOWED, growing: Sequence[str] = GROWING
) -> rrb.Vertical:
    """Return two 3D views: one that follows the entity `followed`, and a top view of all points `places` (n, 3) [m].

    `size` is the tractor size divided by the default size. The content of entities `growing` remains visible.
    """
    east, north = from_heading(yaw, *FOLLOW_FROM[:2])
    following = rrb.EyeControls3D(
        position=places[0] + size * np.array([east, north, FOLLOW_FROM[2]]),
        look_target=places[0] + size * np.array(LOOK_AT),
        tracking_entity=followed,
    )
    low, high = places.min(axis=0), places.max(axis=0)
    above, middle = high[2] + 8.0 + ((high - low)[:2] / VIEWED).max(), (low + high) / 2
    overview = rrb.EyeControls3D(position=(middle[0], middle[1] - TILT * above, above), look_target=middle)
    below = _view(overview, "Top view", growing, BEYOND, ["+ $origin/**", f"- /{NAMES}/**"])
    views = _view(following, "Tractor", growing, SKY), below
    return rrb.Vertical(*views, row_shares=[3, 2])


@lru_cache(maxsize=64)
def whole_run(end_s: float, room: float = 0.0) -> rrb.TimeAxis:
    """Return a time axis for a run of `end_s` [s], with the fraction `room` of the axis reserved for a legend."""
    return rrb.TimeAxis(view_range=rr.TimeRange(_seconds(0.0), _seconds(time_end(end_s, room))))


def _seconds(t: float) -> rr.TimeRangeBoundary:
    return rr.TimeRangeBoundary.absolute(seconds=t)


def plot_view(plot: Plot, end_s: float, frame: Frame, share: float) -> rrb.TimeSeriesView:
    """Return the viewer's view of a plot, whose height is the fraction `share` of the tab. A single line has no
    legend."""
    axis = whole_run(end_s, frame.room)
    shown = frame.values
    cut = f"; clipped, maximum {shown.beyond:.4g}" if shown and shown.beyond is not None else ""
    values = rrb.ScalarAxis(range=readable(shown.low, shown.high, most_steps(share))) if shown else None
    legend = rrb.PlotLegend(frame.legend, visible=plot.legend and len(plot.series) > 1)
    mean = f"; bold: {frame.mean_s:g} s mean" if frame.mean_s else ""
    name = f"{plot.title} [{plot.unit}]{cut}{mean}"
    return rrb.TimeSeriesView(origin=plot.entity, name=name, axis_x=axis, axis_y=values, plot_legend=legend)


def _map(shown: Map) -> rrb.Spatial2DView:
    height, width = shown.sizes
    bounds = rrb.VisualBounds2D(x_range=[-0.4 * width, 1.1 * width], y_range=[-0.3 * height, 1.05 * height])
    return rrb.Spatial2DView(origin=shown.entity, name=shown.title, visual_bounds=bounds)


def _view(
    eye: rrb.EyeControls3D, name: str, growing: Sequence[str], behind: int, contents: Sequence[str] = ("$origin/**",)
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="world",
        contents=list(contents),
        name=name,
        eye_controls=eye,
        line_grid=False,
        background=rrb.Background(color=behind),
        overrides=dict.fromkeys(growing, SO_FAR),
    )

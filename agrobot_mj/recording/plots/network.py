"""Plots of the fuzzy neural network of a run: parameters, and heat maps of the normalised firing strengths.

The log columns determine the size of the network. Heat maps are recorded four times per second, with the value of each
cell as text.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.components import ImageBufferBatch, TextBatch

from agrobot_mj.core.palette import (
    BROWN,
    GREEN,
    LIGHT_GREY,
    ORANGE,
    PINK,
    ROYAL_BLUE,
    SKY_BLUE,
    VERMILION,
    YELLOW,
    rgba,
)
from agrobot_mj.core.signals import Array
from agrobot_mj.recording.plots.catalogue import NETWORK, Plot, Series
from agrobot_mj.recording.transport.timeline import Index, Times, data_column, send
from agrobot_mj.simulation.log import Rows

COLOURS = tuple(
    rgba(colour) for colour in (SKY_BLUE, ORANGE, GREEN, PINK, VERMILION, YELLOW, ROYAL_BLUE, LIGHT_GREY, BROWN)
)
MOST_LINES = 18  # Maximum number of lines of a plot. For larger networks, evenly spaced parameters are plotted.
EVERY_TICKS = 5  # Number of ticks between heat maps, and between points of the parameter plots. Both vary slowly.
MOST_LABELS = 64  # Maximum number of cells of a heat map whose values are shown as text
BESIDE, ABOVE = 0.2, 0.2
"""Distances of the names of the fuzzy sets from a heat map: left of the map [fraction of its width], and above the map
[fraction of its height]."""
MOST_SHARE = 1e3  # Normalised firing strength above which the network has diverged and heat maps are omitted [-]
PICTURE, LABELS = rr.DepthImage.descriptor_buffer(), rr.Points2D.descriptor_labels()
INPUTS = {"1": "deg/s", "2": "deg/s2"}
"""Units of the two network inputs: x1 is the yaw-rate error, and x2 is its derivative."""


class Map(NamedTuple):
    """Heat map of firing strengths. Each row is a fuzzy set of input x1, and each column is a fuzzy set of input x2."""

    entity: str
    title: str
    sizes: tuple[int, int]
    columns: Index  # Columns of the log that contain the values of the cells, row by row


def network_plots(columns: Sequence[str]) -> list[Plot]:
    """Return the plots of the network parameters in the log `columns`, or an empty list for a run without a network."""
    if not family("c1", columns):
        return []
    return [
        Plot("network/q", "Weight of the lower firing level, q", "-", (Series("q", "q", NETWORK),)),
        Plot(
            *("network/consequents", "Consequents f; width: set of x1, colour: x2", "deg"),
            *(_lines([_rule(name) for name in family("f", columns)]), EVERY_TICKS),
            legend=False,
        ),
        *(_sets(f"network/centres_{k}", f"Centres of the sets of x{k}", k, (f"c{k}",), columns) for k in INPUTS),
        *(
            _sets(f"network/widths_{k}", f"Widths of x{k}, upper bold", k, (f"d{k}_lower", f"d{k}_upper"), columns)
            for k in INPUTS
        ),
    ]


def _sets(path: str, title: str, k: str, families: tuple[str, ...], columns: Sequence[str]) -> Plot:
    unit = INPUTS[k]
    lines = _lines([_fuzzy_set_line(name) for start in families for name in family(start, columns)])
    widths = path.startswith("network/widths")
    return Plot(path, title, unit, lines, EVERY_TICKS, may_be_cut=widths, legend=not widths)


def _rule(column: str) -> Series:
    """Return the plot line of a rule consequent. The colour of the line depends on the fuzzy set of x2, and its width
    depends on the fuzzy set of x1."""
    i, j = (int(number) for number in column.split("_")[1:])
    return Series(f"{i},{j}", column, COLOURS[j % len(COLOURS)], wider=i)


def _fuzzy_set_line(column: str) -> Series:
    """Return the plot line of a fuzzy-set parameter. Its colour identifies the set, and its width identifies the
    bound."""
    kind, _, number = column.rpartition("_")
    bound = kind[1:].partition("_")[2]
    return Series(
        f"{bound} {number}".strip(), column, COLOURS[int(number) % len(COLOURS)], wider=2 * (bound == "upper")
    )


def _lines(series: list[Series]) -> tuple[Series, ...]:
    chosen = np.linspace(0, len(series) - 1, min(len(series), MOST_LINES)).astype(int)
    return tuple(series[i] for i in chosen)


def family(start: str, columns: Sequence[str]) -> list[str]:
    """Return the columns whose name is `start` followed by one or two indices, such as `start`_0 or `start`_0_0."""
    return [name for name in columns if name.startswith(f"{start}_") and name.removeprefix(f"{start}_")[0].isdigit()]


def network_columns(columns: Sequence[str]) -> list[str]:
    """Return the names of the network columns among the log `columns`, or an empty list for a run without a network."""
    if not family("c1", columns):
        return []
    starts = ("c1", "c2", "d1_lower", "d1_upper", "d2_lower", "d2_upper", "f", "w_lower", "w_upper")
    return [name for start in starts for name in family(start, columns)]


class Firing:
    """Recorder that sends heat maps of the rule firing strengths to a recording."""

    def __init__(self, rows: Rows) -> None:
        self.rows, columns = rows, rows.columns
        sizes = len(family("c1", columns)), len(family("c2", columns))
        self.maps = [
            Map(
                f"network/firing_{bound}",
                f"Normalised firing of the rules, {bound} [-]",
                sizes,
                np.array([columns.index(name) for name in found]),
            )
            for bound in ("lower", "upper")
            if (found := family(f"w_{bound}", columns))
        ]

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send a heat map for every fifth log row from `first` to `rows.filled`; `times` (n,) are the times of the
        rows."""
        chosen = np.flatnonzero((first + np.arange(len(times))) % EVERY_TICKS == 0)
        for shown in self.maps:
            values = self.rows.values[np.ix_(first + chosen, shown.columns)]
            there = (np.abs(values) <= MOST_SHARE).all(axis=1)  # False for NaN
            if first == 0:
                self._frame(stream, shown)
            if there.any():
                self._send(stream, shown, times[chosen][there], values[there])

    def _send(self, stream: rr.RecordingStream, shown: Map, times: Times, values: Array) -> None:
        send(stream, shown.entity, times, [data_column(PICTURE, ImageBufferBatch(_buffers(values)))])
        if values.shape[1] <= MOST_LABELS:
            labels = TextBatch([f"{value:.2f}" for value in values.ravel().tolist()])
            send(stream, f"{shown.entity}/values", times, [data_column(LABELS, labels, values.shape[1])])

    def _frame(self, stream: rr.RecordingStream, shown: Map) -> None:
        height, width = shown.sizes
        brightest = min(4.0 / (height * width), 1.0)  # four times the value for equal firing of all rules
        size = rr.components.ImageFormat(width=width, height=height, channel_datatype=rr.ChannelDatatype.F32)
        viridis = rr.components.Colormap.Viridis
        picture = rr.DepthImage.from_fields(format=size, meter=1.0, colormap=viridis, depth_range=[0.0, brightest])
        stream.log(shown.entity, picture, static=True)
        cells = [(j + 0.5, i + 0.5) for i in range(height) for j in range(width)]
        if len(cells) <= MOST_LABELS:
            stream.log(f"{shown.entity}/values", _text(cells, 0xFFFFFFFF), static=True)
        beside = [(-BESIDE * width, i + 0.5) for i in range(height)]
        above = [(j + 0.5, -ABOVE * height) for j in range(width)]
        names = [f"x1 set {i}" for i in range(height)] + [f"x2 set {j}" for j in range(width)]
        stream.log(f"{shown.entity}/sets", _text(beside + above, 0xBBBBBBFF, names), static=True)


def _buffers(values: Array) -> pa.Array:
    """Return one image per row of `values` (n, cells) as an Arrow array, which avoids Rerun's slow conversion."""
    cells = values.astype(np.float32)
    ends = np.arange(len(cells) + 1, dtype=np.int32) * cells.strides[0]
    kind = ImageBufferBatch([]).as_arrow_array().type
    return pa.ListArray.from_arrays(ends, pa.array(cells.view(np.uint8).ravel()), type=kind)


def _text(places: list[tuple[float, float]], colour: int, labels: list[str] | None = None) -> rr.Points2D:
    """Return text labels at the positions `places`. If `labels` is None, the labels logged before remain."""
    return rr.Points2D.from_fields(
        positions=places, labels=labels, colors=[colour], radii=rr.Radius.ui_points(0.0), show_labels=True
    )

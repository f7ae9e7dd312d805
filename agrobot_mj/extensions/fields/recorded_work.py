"""Worked area recorded by AgOpenGPS in Sections.txt, and true worked area of a run that AgOpenGPS steered.

Sections.txt contains a triangle strip for each section and stretch of work: the number of rows, a row with the colour,
then points alternately on the left and right edge. In a run of the command `link`, a section works while its bit in the
steering messages of the host is set.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.agopengps.messages import SteerData
from agrobot_mj.core.agopengps.wire import decode
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geodesy import Origin, geodetic_points, local_points
from agrobot_mj.core.palette import BLUE, LIGHT_GREY, ORANGE, VERMILION
from agrobot_mj.core.resources import absence
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.boom import Boom, ImplementMotion, strip, worked_area
from agrobot_mj.extensions.fields.coverage import FieldCoverage, areas, coverage
from agrobot_mj.extensions.fields.evaluation import SIGNALS, implement_motion
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.planner.area import whole_of
from agrobot_mj.extensions.fields.planner.rig import outline_of
from agrobot_mj.paths.imports.agopengps import comma_numbers
from agrobot_mj.paths.imports.reading import MAX_BYTES
from agrobot_mj.paths.imports.reading import decode as decode_text
from agrobot_mj.paths.imports.shapes import LARGEST
from agrobot_mj.scenario.loading import load_scenario

SECTIONS = "Sections.txt"
LOST_S = 2.0  # Duration without a steering message after which all sections are off [s]
PIECE_M = 25.0
"""Maximum length of a stretch of work [m]. Overlaps are computed between stretches, as between strips of the host."""


def recorded_strips(file: Path) -> list[BaseGeometry]:
    """Return the area of each strip in a Sections.txt. Raise `ScenarioError` for an unusable file."""
    if not file.is_file():
        raise ScenarioError(f"{file}: {absence(file, 'specify the folder of a field with recorded work')}")
    try:
        if file.stat().st_size > MAX_BYTES:
            raise ValueError(f"the file is larger than {MAX_BYTES / 1e6:.0f} MB; split the field")
        strips = [_area(points) for points in _tables(decode_text(file.read_bytes()).splitlines())]
    except (ValueError, OSError) as error:
        raise ScenarioError(f"{file.name}: {error}") from None
    if not (found := [each for each in strips if each.area > 0]):
        raise ScenarioError(
            f"{file.name}: the file contains no worked area; work with sections on, then save the field"
        )
    return found


def _tables(lines: list[str]) -> Iterator[Array]:
    """Yield the points of each strip, shape (n, 2) [m]. Rows that are not a count are omitted, as in AgOpenGPS."""
    k = 0
    while k < len(lines):
        line, k = lines[k].strip(), k + 1
        if not line.isdecimal():
            continue
        rows = lines[k : k + int(line)]
        if len(rows) < int(line):
            raise ValueError(f"line {k}: the strip has {line} rows, but the file ends before; save the field again")
        points = [comma_numbers(row, 2) for row in rows[1:]]
        for number, row in enumerate(points, start=k + 2):
            if len(row) < 2 or not np.abs(row).max() <= LARGEST:
                raise ValueError(f"line {number}: {lines[number - 1][:40]!r} is not a position; save the field again")
        yield np.array(points).reshape(-1, 2)
        k += int(line)


def _area(points: Array) -> BaseGeometry:
    """Return the area of a triangle strip with points alternately on the left and right edge, shape (n, 2) [m]."""
    if len(points) < 3:
        return shapely.Polygon()
    left, right = points[::2], points[1::2]
    return strip(left, right if len(right) == len(left) else np.vstack([right, right[-1:]]))


class RunWork(NamedTuple):
    """True work of a run: ground worked in each stretch, and notes about the sections."""

    passes: list[BaseGeometry]
    notes: tuple[str, ...]


def work_of_run(folder: Path, plane: Origin, width: float, sections: int | None) -> RunWork:
    """Return the ground that the sections of the implement worked in a run of `link`, in a local plane.

    `sections` is the number of sections of the implement; None selects the highest section that the host switched on.
    Raise `ScenarioError` if the run was not controlled over a link, or if the host switches a section above `sections`.
    """
    times, masks = _switching(folder / "link.parquet")
    scenario = load_scenario(str(folder / "scenario.toml"))
    guidance: Any = scenario.guidance
    table = _table(folder / "signals.parquet", (*SIGNALS, "link_engaged"))
    signals = {name: np.asarray(table[name].to_numpy(), dtype=float) for name in table.column_names}
    notes = list[str]()
    if not masks.any():
        times, masks = signals["t"], np.where(np.nan_to_num(signals["link_engaged"]) > 0, 1, 0)
        notes.append("the host sent no section states, so all sections are counted as on while the host steers")
        sections = 1
    used = int(masks.max()).bit_length()
    if sections and sections < used:
        raise ScenarioError(f"--sections {sections}: the host switches section {used}; specify at least {used}")
    count = sections or used
    motion = implement_motion(signals, outline_of(scenario, width).behind, np.zeros(len(signals["t"])))
    origin = Origin(guidance.origin_lat_deg, guidance.origin_lon_deg)
    places = geodetic_points(origin, np.column_stack([motion.x, motion.y]))
    x, y = local_points(plane, places[:, 1], places[:, 0]).T
    return RunWork(list(_stretches(motion._replace(x=x, y=y), times, masks, Boom(width, count))), tuple(notes))


def _switching(file: Path) -> tuple[Array, Array]:
    """Return the times [s] of the steering messages of the host, and the bit masks of its sections, shape (n,) each."""
    table = _table(file, ("t", "direction", "bytes"))
    rows = zip(*(column.to_pylist() for column in table.columns), strict=True)
    found = [(t, message.sections) for t, way, data in rows if way == "in" and (message := _steering(data))]
    times, masks = np.array([t for t, _ in found]), np.array([mask for _, mask in found], dtype=np.int64)
    lost = np.flatnonzero(np.diff(times, append=np.inf) > LOST_S)
    order = np.argsort(np.concatenate([times, times[lost] + LOST_S]), kind="stable")
    off = np.zeros(len(lost), dtype=np.int64)
    return np.concatenate([times, times[lost] + LOST_S])[order], np.concatenate([masks, off])[order]


def _table(file: Path, columns: Sequence[str]) -> pa.Table:
    """Return the columns in `columns` that a file of a run contains. Raise `ScenarioError` for an unusable file."""
    if not file.is_file():
        raise ScenarioError(f"{file}: {absence(file, 'specify the folder of a run of the command link')}")
    try:
        return pq.ParquetFile(file.absolute()).read([*columns])
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ScenarioError(f"{file}: this is not a file of a run: {str(error).splitlines()[0]}") from None


def _steering(datagram: bytes) -> SteerData | None:
    message = decode(datagram)
    return message if isinstance(message, SteerData) else None


def _stretches(motion: ImplementMotion, times: Array, masks: Array, boom: Boom) -> Iterator[BaseGeometry]:
    """Yield the ground worked in each stretch of at most `PIECE_M` with constant states of the sections."""
    travelled = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(motion.x), np.diff(motion.y)))))
    changes = 1 + np.flatnonzero(np.diff(masks))
    pieces = 1 + np.flatnonzero(np.diff(np.floor(travelled / PIECE_M)))
    start, end = motion.t[0], motion.t[-1]
    marks = np.concatenate([[start, end], times[changes].clip(start, end), motion.t[pieces]])
    for first, last in pairwise(np.unique(marks).tolist()):
        k = int(np.searchsorted(times, first, "right")) - 1
        mask = int(masks[k]) if k >= 0 else 0
        on = [(first, last) if mask >> section & 1 else None for section in range(boom.sections)]
        if any(on) and (ground := worked_area(motion, on, boom)).area > 0:
            yield ground


class WorkComparison(NamedTuple):
    """True worked area of a run, and worked area recorded by the host."""

    true: FieldCoverage
    host: FieldCoverage

    @property
    def recorded_only(self) -> BaseGeometry:
        """Ground inside the field that the host recorded, but the implement has not worked."""
        return self.host.union.difference(self.true.union).intersection(self.true.field)

    @property
    def worked_only(self) -> BaseGeometry:
        """Ground inside the field that the implement has worked, but the host has not recorded."""
        return self.true.union.difference(self.host.union).intersection(self.true.field)

    def numbers(self) -> dict[str, Any]:
        """Return the areas of the field [m2 and %] according to the run and to the host, and their differences [m2]."""
        return {
            "areas": {"true": areas(self.true)["field"], "host": areas(self.host)["field"]},
            "recorded_only_m2": self.recorded_only.area,
            "worked_only_m2": self.worked_only.area,
        }

    def layers(self) -> Iterator[tuple[BaseGeometry, str, str]]:
        """Yield polygon, colour and name of the areas of a map."""
        yield self.true.union.intersection(self.host.union), LIGHT_GREY, "worked and recorded"
        yield self.recorded_only, BLUE, "only recorded"
        yield self.worked_only, ORANGE, "only worked"
        yield self.true.missed.intersection(self.host.missed), VERMILION, "neither"


def comparison(field: Field, strips: list[BaseGeometry], passes: list[BaseGeometry]) -> WorkComparison:
    """Return the comparison of the recorded strips with the true passes on a field. Raise `ScenarioError` if all strips
    or all passes are outside the field."""
    whole = whole_of(field)
    for what, fix, parts in (
        (f"the work in {SECTIONS}", "specify the folder in which this work was recorded", strips),
        ("the work of the run", "compare the StartFix in Field.txt with the origin of the run", passes),
    ):
        away = min((each.distance(whole) for each in parts), default=0.0)
        if away > 0.0:
            raise ScenarioError(f"{field.name}: {what} is {away:.0f} m away from the field; {fix}")
    return WorkComparison(coverage(whole, whole, passes), coverage(whole, whole, strips))


def comparison_lines(content: dict[str, Any]) -> list[str]:
    """Return the results of a comparison and its notes as lines of text."""
    parts = content["areas"]
    lines = [f"{'area [m2]':12}{'true':>12}{'recorded':>12}"]
    for name in ("worked", "overlapped", "missed"):
        lines.append(f"{name:12}" + "".join(f"{parts[each][f'{name}_m2']:12.1f}" for each in ("true", "host")))
    only = content["recorded_only_m2"], content["worked_only_m2"]
    text = f"recorded but not worked: {only[0]:.1f} m2; worked but not recorded: {only[1]:.1f} m2"
    return [*lines, text, *content["notes"]]

"""Pieces of recordings that can be driven and fitted: cut at gaps, at standstill, and where the position is lost.

Within a piece every input is known without a gap, the machine moves but for short stops, and positions, where the log
has any, arrive all along. The speed has its sign (`direction`).
"""

from collections.abc import Iterable, Iterator, Sequence
from math import degrees, inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.columns import FieldLogError, Mask
from agrobot_mj.fieldlogs.direction import directed
from agrobot_mj.fieldlogs.recording import LONGEST_GAP_S, FieldRecording

STANDING_M_S = 0.1
"""Speed below which a machine stands [m/s]. Estimate: three times the noise of a standing receiver."""
STANDING_S = 2.0
"""Time from which on it stands in the way [s]: shorter stops belong to the drive."""
LOST_S = 2.0
"""Time without a position from which on it is lost [s]; three times the spacing for slower receivers."""
SHORTEST_S = 5.0
"""Shortest piece [s]: a window of the fit, half a window of the replay."""
TURNED_DEG = 15.0
"""Angle between heading and course from which on the heading is told to be turned [deg]."""


class Span(NamedTuple):
    """A stretch of time that is left out, and why."""

    start: float
    end: float
    why: str


class Pieces(NamedTuple):
    """What is kept of recordings, and sentences about it."""

    kept: tuple[FieldRecording, ...]
    notes: tuple[str, ...]


def pieces(recordings: Iterable[FieldRecording], start: float = 0.0, end: float = inf) -> Pieces:
    """Pieces of all recordings, each between `start` and `end` of its own time [s].

    Raises `FieldLogError` where nothing is left.
    """
    kept, notes = list[FieldRecording](), list[str]()
    for recording in recordings:
        found = directed(recording)
        whole, bounds = found.recording, recording.bounds(start, end)
        out = sorted(_left_out(whole))
        spans = list(_between(out, *bounds, min(SHORTEST_S, bounds[1] - bounds[0])))
        kept += [whole.between(*span) for span in spans]
        notes.append(_note(whole, bounds, spans, out))
        if found.reverse_m:
            how = "heading" if recording.heading is not None else "turns of the course"
            notes.append(
                f"{recording.name}: the speed has no sign; by the {how} {found.reverse_m:.1f} m are in reverse"
            )
        if found.mounting is not None and abs(degrees(found.mounting)) > TURNED_DEG:
            notes.append(f"{recording.name}: the heading is {degrees(found.mounting):+.0f} deg off the course")
    if not kept:
        raise FieldLogError("; ".join(notes) + "; take a log that drives for longer")
    return Pieces(tuple(kept), tuple(notes))


def _left_out(recording: FieldRecording) -> Iterator[Span]:
    """Stretches without an input, without a position, and at standstill."""
    for part, column in recording.inputs.items():
        yield from (Span(a, b, f"gap in {column!r}") for a, b in _gaps(getattr(recording, part).t, LONGEST_GAP_S))
    if (fixes := recording.position) is not None:
        t = np.concatenate(([recording.start], fixes.t, [recording.end]))
        longest = max(LOST_S, 3 * float(np.median(np.diff(fixes.t))))
        yield from (Span(a, b, "no position") for a, b in _gaps(t, longest))
    speed = recording.speed
    for first, after in spells(np.abs(speed.value) < STANDING_M_S):
        a, b = float(speed.t[first]), float(speed.t[after - 1])
        if b - a > STANDING_S:
            yield Span(a, b, "standing")


def spells(mask: Mask) -> list[tuple[int, int]]:
    """First index, and the one behind the last, of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask, [0])).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _gaps(t: Array, longest: float) -> list[tuple[float, float]]:
    return [(float(t[k]), float(t[k + 1])) for k in np.flatnonzero(np.diff(t) > longest)]


def _between(out: list[Span], start: float, end: float, shortest: float) -> Iterator[tuple[float, float]]:
    """Stretches from `start` to `end` that no span covers, of at least `shortest` [s]."""
    for span in (*out, Span(end, end, "")):
        if min(span.start, end) - start >= shortest:
            yield start, min(span.start, end)
        start = max(start, span.end)


def _note(
    recording: FieldRecording, bounds: tuple[float, float], spans: list[tuple[float, float]], out: list[Span]
) -> str:
    """What is kept of a recording, and what is left out why."""
    kept, whole = sum(b - a for a, b in spans), bounds[1] - bounds[0]
    text = f"{recording.name}: {kept:.0f} of {whole:.0f} s kept"
    if spans and len(spans) < 7:
        text += f" ({', '.join(f'{a:.1f}-{b:.1f}' for a, b in spans)} s)"
    elif spans:
        text += f" in {len(spans)} pieces"
    lost = dict.fromkeys((span.why for span in out), 0.0)
    for span in out:
        lost[span.why] += max(0.0, min(span.end, bounds[1]) - max(span.start, bounds[0]))
    parts = [f"{why} {seconds:.1f} s" for why, seconds in lost.items() if seconds > 0]
    return text + (f"; left out: {', '.join(parts)}" if parts else "")


def split(kept: Sequence[FieldRecording], share: float) -> tuple[list[FieldRecording], list[FieldRecording]]:
    """The first `share` of the time in pieces, and the rest; the piece that holds the border is cut there."""
    left = share * sum(each.end - each.start for each in kept)
    first, second = list[FieldRecording](), list[FieldRecording]()
    for each in kept:
        length = each.end - each.start
        if left > 1.0:
            first.append(each.between(each.start, each.start + left))
        if length - left > 1.0:
            second.append(each.between(each.start + max(left, 0.0), each.end))
        left -= length
    return first, second

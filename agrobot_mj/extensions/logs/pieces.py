"""Segments of recordings for replay and fit, separated by gaps, standstill and loss of position.

In a segment, inputs and positions have no gaps, and the machine is in motion except for short stops. The module
`direction` first determines the sign of an unsigned speed.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import degrees, inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Mask, Source
from agrobot_mj.extensions.logs.direction import STANDING_M_S, is_signed, with_direction
from agrobot_mj.extensions.logs.identify.windows import FIT_S
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.recording import LONGEST_GAP_S, FieldRecording, read_recording
from agrobot_mj.extensions.logs.series import TimeSeries, axle_speed, longest_pause

STANDING_S = 2.0  # Duration of a standstill above which it separates segments [s]
SHORTEST_S = 5.0  # Minimum duration of a segment [s]: one window of the fit, half a window of the replay
FEWEST_BURSTS = 4  # Minimum number of sections between gaps for a recording to count as written in bursts
TWO_SPEEDS = 1.5  # Minimum ratio of fast to slow speed in a log that contains two speeds [-]
TURNED_DEG = 15.0  # Minimum angle between heading and course that is reported [deg]


class Span(NamedTuple):
    """Omitted time interval of a recording, with the reason."""

    start: float
    end: float
    why: str


class Pieces(NamedTuple):
    """Usable segments of recordings, with notes about used and omitted data."""

    kept: tuple[FieldRecording, ...]
    notes: tuple[str, ...]
    signed: bool
    """Whether the recorded speed is negative in reverse. Otherwise, most of the distance is assumed to be forwards."""


def pieces(recordings: Iterable[FieldRecording], start: float = 0.0, end: float = inf) -> Pieces:
    """Return the usable segments of all recordings, from `start` to `end` [s] after the first row of each recording.

    Raises `FieldLogError` if no segment remains.
    """
    kept, notes, signed, recordings = list[FieldRecording](), list[str](), False, list(recordings)
    for recording in recordings:
        signed |= is_signed(recording)
        found = with_direction(recording)
        whole, bounds = _at_axle(found.recording), recording.bounds(start, end)
        out = sorted(_left_out(whole))
        spans = list(_between(out, *bounds, min(SHORTEST_S, bounds[1] - bounds[0])))
        kept += [whole.between(*span) for span in spans]
        notes.append(_note(whole, bounds, spans, out))
        notes += [f"{recording.name}: {each}" for each in recording.notes]
        if found.reverse_m:
            notes.append(
                f"{recording.name}: the speed has no sign; according to {found.how}, {found.reverse_m:.1f} m were "
                "driven in reverse; if this is wrong, set speed.signed = true"
            )
        if found.mounting is not None and abs(degrees(found.mounting)) > TURNED_DEG:
            notes.append(f"{recording.name}: the heading is {degrees(found.mounting):+.0f} deg off the course")
    if not kept:
        raise FieldLogError(f"{'; '.join(notes)}; {_remedy(recordings)}")
    return Pieces(tuple(kept), tuple(notes), signed)


def _at_axle(recording: FieldRecording) -> FieldRecording:
    """Return the recording with the speed of the rear axle, converted if the recorded speed is the antenna speed."""
    if not recording.antenna_speed or recording.yaw_rate is None:
        return recording
    (t, v), (ahead, left, _) = recording.speed, recording.arm
    return recording._replace(speed=TimeSeries(t, axle_speed(v, np.interp(t, *recording.yaw_rate), ahead, left)))


class Bursts(NamedTuple):
    """Statistics of bursts: sections of a recording between gaps of the inputs."""

    number: int
    length: float  # Median duration of a burst [s]
    period: float  # Median time from the start of one burst to the start of the next [s]


def bursts(recording: FieldRecording) -> Bursts | None:
    """Return burst statistics of a recording. Return None if there are fewer than `FEWEST_BURSTS` bursts, or if the
    bursts are long enough for a fit."""
    gaps = sorted({gap for part in recording.inputs for gap in _gaps(getattr(recording, part).t, LONGEST_GAP_S)})
    starts = np.array([recording.start, *(end for _, end in gaps)])
    ends = np.array([*(start for start, _ in gaps), recording.end])
    lengths = (ends - starts)[ends > starts]
    if len(lengths) < FEWEST_BURSTS or np.median(lengths) >= FIT_S:
        return None
    return Bursts(len(lengths), float(np.median(lengths)), float(np.median(np.diff(starts))))


def _remedy(recordings: Sequence[FieldRecording]) -> str:
    """Return advice for recording a log with sufficiently long segments."""
    for recording in recordings:
        if found := bursts(recording):
            return (
                f"the log has {found.number} bursts of {found.length:.1f} s, one every {found.period:.1f} s, but a "
                f"segment needs {SHORTEST_S:g} s; record without pauses"
            )
    return "use a log with more time in motion"


def read_pieces(
    source: Source | Sequence[Source],
    log_map: LogMap | None,
    antenna_height: float,
    start: float = 0.0,
    end: float = inf,
    readings: bool = False,
) -> Pieces:
    """Read one or more logs with a common column map, and return their segments."""
    sources = source if isinstance(source, Sequence) else [source]
    return pieces((read_recording(each, log_map, antenna_height, readings) for each in sources), start, end)


def _left_out(recording: FieldRecording) -> Iterator[Span]:
    """Yield the time intervals that lack an input or a position, and the intervals at standstill."""
    for part, column in recording.inputs.items():
        yield from (Span(a, b, f"gap in {column!r}") for a, b in _gaps(getattr(recording, part).t, LONGEST_GAP_S))
    if (fixes := recording.position) is not None:
        t = np.concatenate(([recording.start], fixes.t, [recording.end]))
        yield from (Span(a, b, "no position") for a, b in _gaps(t, longest_pause(fixes.t)))
    speed = recording.speed
    for first, after in spells(np.abs(speed.value) < STANDING_M_S):
        a, b = float(speed.t[first]), float(speed.t[after - 1])
        if b - a > STANDING_S:
            yield Span(a, b, "standstill")


def spells(mask: Mask) -> list[tuple[int, int]]:
    """Return the start index and the end index (exclusive) of each sequence of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask, [0])).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _gaps(t: Array, longest: float) -> list[tuple[float, float]]:
    return [(float(t[k]), float(t[k + 1])) for k in np.flatnonzero(np.diff(t) > longest)]


def _between(out: list[Span], start: float, end: float, shortest: float) -> Iterator[tuple[float, float]]:
    """Yield the intervals of at least `shortest` [s] between the omitted spans `out`, from `start` to `end` [s]."""
    for span in (*out, Span(end, end, "")):
        if min(span.start, end) - start >= shortest:
            yield start, min(span.start, end)
        start = max(start, span.end)


def _note(
    recording: FieldRecording, bounds: tuple[float, float], spans: list[tuple[float, float]], out: list[Span]
) -> str:
    """Return a sentence with the used and the omitted time of a recording."""
    kept, whole = sum(b - a for a, b in spans), bounds[1] - bounds[0]
    text = f"{recording.name}: {kept:.0f} of {whole:.0f} s are used"
    if spans and len(spans) < 7:
        text += f" ({', '.join(f'{a:.1f}-{b:.1f}' for a, b in spans)} s)"
    elif spans:
        text += f" in {len(spans)} segments"
    lost = dict.fromkeys((span.why for span in out), 0.0)
    for span in out:
        lost[span.why] += max(0.0, min(span.end, bounds[1]) - max(span.start, bounds[0]))
    parts = [f"{why} {seconds:.1f} s" for why, seconds in lost.items() if seconds > 0]
    return text + (f"; omitted: {', '.join(parts)}" if parts else "")


def excitation(recordings: Sequence[FieldRecording]) -> tuple[Array, Array, Array]:
    """Return speed [m/s], steering rate [deg/s] and curvature [1/m] at intervals of 0.1 s, shape (n,) each."""
    u, rate, bend = (np.concatenate(each) for each in zip(*map(_excitation, recordings), strict=True))
    return u, rate, bend


def _excitation(recording: FieldRecording) -> tuple[Array, Array, Array]:
    t = np.arange(recording.start, recording.end, 0.1)
    u = np.interp(t, *recording.speed)
    steer = np.interp(t, *recording.steer) if recording.steer else np.zeros(len(t))
    yaw_rate = np.interp(t, *recording.yaw_rate) if recording.yaw_rate else np.zeros(len(t))
    return u, degrees(1.0) * np.gradient(steer, 0.1), yaw_rate / np.where(np.abs(u) > 0.1, u, np.inf)


def slow_and_fast(recordings: Sequence[FieldRecording]) -> tuple[float, float]:
    """Return the 10th and the 90th percentile of the absolute speed in all recordings [m/s]."""
    slow, fast = np.percentile(np.abs(excitation(recordings)[0]), [10, 90])
    return float(slow), float(fast)


def split_at(kept: Sequence[FieldRecording], share: float) -> tuple[list[FieldRecording], list[FieldRecording]]:
    """Return the segments before and after the fraction `share` of their total time. A segment across this time is
    divided."""
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

"""Segments of recordings for replay and fit, separated by gaps, standstill and loss of position.

Within a segment, all inputs are available without gaps, the machine moves except for short stops, and positions, if
recorded, arrive throughout. An unsigned speed, as from a GNSS receiver, gets a sign: displacements between fixes,
projected on the heading, are summed to a forward distance. Where this distance decreases by more than the noise, the
tractor has reversed, and the change of direction is at the minimum speed nearby. A heading with an angular offset (two
antennas across the machine) is first rotated by its mean angle to the course, because machines mostly drive forwards.
Without a heading, the course is used, which jumps by half a turn where the tractor changes direction.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import degrees, inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Mask, Source
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.recording import LONGEST_GAP_S, FieldRecording, read_recording
from agrobot_mj.extensions.logs.series import TimeSeries, chords, course_rate, longest_pause

SIGNED = -0.1
"""Minimum below which a recorded speed is signed [m/s]. Assumed value: outside the noise of a receiver at rest."""
LEAST_LEG_M = 0.5
"""Minimum distance of a leg in reverse [m]: ten times the noise of RTK."""
AROUND_S = 2.0
"""Time before and after a change of direction in which the minimum speed is searched [s]."""
LONGEST_STEP_S = 2.0
"""Maximum time between fixes whose displacement is used [s]."""


class Directed(NamedTuple):
    """Recording with a signed speed."""

    recording: FieldRecording
    reverse_m: float
    """Detected distance in reverse [m]; 0 for a signed recorded speed."""
    mounting: float | None
    """Mean angle from the course to the recorded heading [rad]; None if not identifiable."""


def directed(recording: FieldRecording) -> Directed:
    """Return the recording with negative speed in reverse; unchanged if the direction is not identifiable."""
    speed = recording.speed
    if recording.position is None or len(recording.position.t) < 8:
        return Directed(recording, 0.0, None)
    t, step = _displacements(recording.position)
    if recording.heading is not None:
        along = step * np.exp(-1j * recording.heading.at(t))
        mounting = -float(np.angle(along.sum()))
        forward = (along * np.exp(1j * mounting)).real
    else:
        forward, mounting = _by_course(step), None
    if speed.value.min() < SIGNED or (sign := _signs(t, forward, speed)) is None:
        return Directed(recording, 0.0, mounting)
    value = sign * np.abs(speed.value)
    back = float(np.sum(np.maximum(-value[:-1], 0.0) * np.diff(speed.t)))
    return Directed(recording._replace(speed=TimeSeries(speed.t, value)), back, mounting)


def _displacements(position: TimeSeries) -> tuple[Array, Array]:
    """Return middle times [s] and displacements between fixes, complex east + i north [m]; 0 across a gap."""
    step = np.diff(position.value[:, 0] + 1j * position.value[:, 1])
    step[np.diff(position.t) > LONGEST_STEP_S] = 0.0
    return (position.t[:-1] + position.t[1:]) / 2, step


def _by_course(step: Array) -> Array:
    """Return signed displacements; the sign changes where the course reverses between legs of `LEAST_LEG_M`."""
    sign, now, start, leg, before = np.ones(len(step)), 1.0, 0, 0j, 0j
    for k in range(len(step)):
        leg += step[k]
        if abs(leg) < LEAST_LEG_M:
            continue
        if before and (leg * before.conjugate()).real < 0:
            now = -now
        sign[start : k + 1] = now
        before, leg, start = leg, 0j, k + 1
    sign[start:] = now
    forward: Array = sign * np.abs(step)
    return forward if forward.sum() >= 0 else -forward


def _signs(t: Array, forward: Array, speed: TimeSeries) -> Array | None:
    """Return the sign of the speed at its times; None if the tractor always drives forwards."""
    way = np.cumsum(forward)
    turns = sorted(k for up in (way, -way) for k in find_peaks(up, prominence=LEAST_LEG_M)[0])
    signs = np.where(np.diff(way[[0, *turns, -1]]) < 0, -1.0, 1.0)
    if signs.min() > 0:
        return None
    found: Array = signs[np.searchsorted([_slowest(speed, t[k]) for k in turns], speed.t, side="right")]
    return found


def _slowest(speed: TimeSeries, t: float) -> float:
    """Return the time of the minimum speed near `t` [s]."""
    near = np.abs(speed.t - t) < AROUND_S
    return float(speed.t[near][np.abs(speed.value[near]).argmin()]) if near.any() else t


STANDING_M_S = 0.1
"""Speed below which a machine is at standstill [m/s]. Assumed value: three times the noise of a receiver at rest."""
STANDING_S = 2.0
"""Minimum duration of a standstill that separates segments [s]."""
SHORTEST_S = 5.0
"""Minimum duration of a segment [s]: a window of the fit, half a window of the replay."""
CHORD_S, SLIPPED = 2.0, 1.5
"""Time between positions for summed distances [s], and maximum ratio of this distance to that of the speed [-]. Assumed
values."""
AGREED = 0.5
"""Minimum correlation of two yaw rates of one machine, also if mirrored or in another unit [-]. Assumed value:
consistent sensors have 0.9."""
OTHER_UNIT = 5.0
"""Ratio of two yaw rates above which their units differ [-]; deg/s instead of rad/s gives 57."""
LEAST_HZ = 2.5
"""Minimum rate of positions or headings that contain yaw dynamics [Hz]."""
COARSE_M_S = 0.12
"""Resolution of recorded speeds above which rounding biases a fitted scale [m/s]. Assumed value: 1 km/h gives 5 %."""
TWO_SPEEDS = 1.5
"""Minimum ratio of fast to slow speeds in a log with two speeds [-]."""
TURNED_DEG = 15.0
"""Minimum angle between heading and course that is reported [deg]."""


class Span(NamedTuple):
    """Omitted time interval with the reason."""

    start: float
    end: float
    why: str


class Pieces(NamedTuple):
    """Segments used from recordings, with notes."""

    kept: tuple[FieldRecording, ...]
    notes: tuple[str, ...]
    signed: bool
    """Whether a recorded speed is negative in reverse; otherwise most of the distance is assumed to be forwards."""


def pieces(recordings: Iterable[FieldRecording], start: float = 0.0, end: float = inf) -> Pieces:
    """Return the segments of all recordings between `start` and `end` of each recording's time [s].

    Raises `FieldLogError` if no segment remains.
    """
    kept, notes, signed = list[FieldRecording](), list[str](), False
    for recording in recordings:
        signed |= float(recording.speed.value.min()) < SIGNED
        found = directed(recording)
        whole, bounds = found.recording, recording.bounds(start, end)
        out = sorted(_left_out(whole))
        spans = list(_between(out, *bounds, min(SHORTEST_S, bounds[1] - bounds[0])))
        kept += [whole.between(*span) for span in spans]
        notes.append(_note(whole, bounds, spans, out))
        notes += [f"{recording.name}: left out {each}" for each in recording.left_out]
        if found.reverse_m:
            how = "heading" if recording.heading is not None else "turns of the course"
            notes.append(
                f"{recording.name}: the speed has no sign; by the {how} {found.reverse_m:.1f} m are in reverse"
            )
        if found.mounting is not None and abs(degrees(found.mounting)) > TURNED_DEG:
            notes.append(f"{recording.name}: the heading is {degrees(found.mounting):+.0f} deg off the course")
    if not kept:
        raise FieldLogError("; ".join(notes) + "; take a log that drives for longer")
    return Pieces(tuple(kept), tuple(notes), signed)


def read_pieces(
    source: Source | Sequence[Source],
    log_map: LogMap | None,
    antenna_height: float,
    start: float = 0.0,
    end: float = inf,
    readings: bool = False,
) -> Pieces:
    """Return the segments of one or more logs with a common map; see `read_recording` and `pieces`."""
    sources = source if isinstance(source, Sequence) else [source]
    return pieces((read_recording(each, log_map, antenna_height, readings) for each in sources), start, end)


def check_columns(kept: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` for slow, coarse or contradictory columns, such as speeds in a wrong unit."""
    _check_rates(kept)
    _check_speed(kept)
    _check_turning(kept)


def _check_rates(recordings: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` for a constant or coarse sensor, and for positions or headings too infrequent for a fit."""
    name = recordings[0].name
    for part in ("heading", "yaw_rate"):
        values = [series.value for each in recordings if (series := getattr(each, part)) is not None]
        if values and recordings[0].yaw_rate_source != "course" and not np.ptp(np.concatenate(values)):
            raise FieldLogError(f"{name}: [{part}] never changes; name another column, or omit it in the map")
    readings = np.unique(np.concatenate([each.speed.value for each in recordings]))
    step = float(np.diff(readings).min()) if len(readings) > 1 else 0.0
    if step > COARSE_M_S and np.allclose(readings / step, np.round(readings / step), atol=0.02):
        raise FieldLogError(f"{name}: [speed] comes in steps of {step:.2g} m/s, too coarse for a fit; log more digits")
    for part in ("heading", "position"):
        steps = [np.diff(series.t) for each in recordings if (series := getattr(each, part)) is not None]
        if steps and (rate := 1.0 / float(np.median(np.concatenate(steps)))) < LEAST_HZ:
            raise FieldLogError(
                f"{name}: a {part} comes {rate:.2g} times a second, a fit needs {LEAST_HZ:g}; log every "
                f"one of the receiver, or omit [{part}] in the map where there is a gyro"
            )


def _check_speed(recordings: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` if speeds and positions differ by more than slip, which indicates a wrong unit."""
    way = said = 0.0
    for piece in recordings:
        if piece.position is not None and len(piece.position.t):
            t, chord = chords(piece.position, CHORD_S)
            way += float(chord.sum())
            said += float(np.abs(np.interp((t[1:] + t[:-1]) / 2, *piece.speed)).sum()) * CHORD_S
    if said and not 1 / SLIPPED < way / said < SLIPPED:
        raise FieldLogError(
            f"{recordings[0].name}: its positions move by {way:.0f} m, its speed makes {said:.0f} m; check the unit of "
            "[speed] and the columns of [position] in the map"
        )


def _check_turning(recordings: Sequence[FieldRecording]) -> None:
    """Raise `FieldLogError` if the track turns opposite to the yaw rate (mirrored) or much faster (wrong unit)."""
    pairs = [pair for piece in recordings if (pair := _turning_twice(piece)) is not None]
    if not pairs:
        return
    course, rate = (each - each.mean() for each in np.concatenate(pairs, axis=1))
    common, turned = float((course * rate).sum()), float((rate**2).sum())
    source, alike = recordings[0].yaw_rate_source, AGREED * sqrt(turned * float((course**2).sum()))
    if common > alike and not 1 / OTHER_UNIT < common / turned < OTHER_UNIT:
        raise FieldLogError(
            f"{recordings[0].name}: its positions turn {common / turned:.2g} times as fast as its {source} says; check "
            f"the unit and the column of [{'yaw_rate' if source == 'gyro' else 'heading'}] in the map"
        )
    if common < -alike:
        key = "yaw_rate.positive" if source == "gyro" else "heading.convention"
        raise FieldLogError(
            f"{recordings[0].name}: its positions turn right where its {source} turns left; are the columns of "
            f"[position] exchanged, east for north? If not, change {key} in the map"
        )


def _turning_twice(piece: FieldRecording) -> Array | None:
    """Return the rates of course and yaw at common times, shape (2, n) [rad/s]; None unless recorded independently."""
    if piece.position is None or piece.yaw_rate is None or piece.yaw_rate_source == "course":
        return None
    course = course_rate(piece.position, piece.speed)
    return None if course is None else np.stack([course.value, np.interp(course.t, *piece.yaw_rate)])


def _left_out(recording: FieldRecording) -> Iterator[Span]:
    """Yield the intervals without an input, without a position, and at standstill."""
    for part, column in recording.inputs.items():
        yield from (Span(a, b, f"gap in {column!r}") for a, b in _gaps(getattr(recording, part).t, LONGEST_GAP_S))
    if (fixes := recording.position) is not None:
        t = np.concatenate(([recording.start], fixes.t, [recording.end]))
        yield from (Span(a, b, "no position") for a, b in _gaps(t, longest_pause(fixes.t)))
    speed = recording.speed
    for first, after in spells(np.abs(speed.value) < STANDING_M_S):
        a, b = float(speed.t[first]), float(speed.t[after - 1])
        if b - a > STANDING_S:
            yield Span(a, b, "standing")


def spells(mask: Mask) -> list[tuple[int, int]]:
    """Return the start and end index (exclusive) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask, [0])).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _gaps(t: Array, longest: float) -> list[tuple[float, float]]:
    return [(float(t[k]), float(t[k + 1])) for k in np.flatnonzero(np.diff(t) > longest)]


def _between(out: list[Span], start: float, end: float, shortest: float) -> Iterator[tuple[float, float]]:
    """Yield the intervals from `start` to `end` outside the omitted ones, of at least `shortest` [s]."""
    for span in (*out, Span(end, end, "")):
        if min(span.start, end) - start >= shortest:
            yield start, min(span.start, end)
        start = max(start, span.end)


def _note(
    recording: FieldRecording, bounds: tuple[float, float], spans: list[tuple[float, float]], out: list[Span]
) -> str:
    """Return a text about the used and omitted parts of a recording."""
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


def excitation(recordings: Sequence[FieldRecording]) -> tuple[Array, Array, Array]:
    """Return speed [m/s], steering rate [deg/s] and curvature [1/m] at regular times, shape (n,) each."""
    u, rate, bend = (np.concatenate(each) for each in zip(*map(_excitation, recordings), strict=True))
    return u, rate, bend


def _excitation(recording: FieldRecording) -> tuple[Array, Array, Array]:
    t = np.arange(recording.start, recording.end, 0.1)
    u = np.interp(t, recording.speed.t, recording.speed.value)
    steer = np.interp(t, *recording.steer) if recording.steer else np.zeros(len(t))
    yaw_rate = np.interp(t, *recording.yaw_rate) if recording.yaw_rate else np.zeros(len(t))
    return u, degrees(1.0) * np.gradient(steer, 0.1), yaw_rate / np.where(np.abs(u) > 0.1, u, np.inf)


def slow_and_fast(recordings: Sequence[FieldRecording]) -> tuple[float, float]:
    """Return the 10th and 90th percentile of the speed in recordings [m/s]."""
    slow, fast = np.percentile(np.abs(excitation(recordings)[0]), [10, 90])
    return float(slow), float(fast)


def split(kept: Sequence[FieldRecording], share: float) -> tuple[list[FieldRecording], list[FieldRecording]]:
    """Return the first fraction `share` of the time in segments, and the rest; one segment is cut at the border."""
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

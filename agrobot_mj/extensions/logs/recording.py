"""Recordings in SI units: columns of a log converted with a map and corrected for latency.

Inputs (steering, speed) are complete except for short gaps. Measured channels (yaw rate, heading, position) may have
gaps of any length. Time counts from the first row. Implausible values are rejected, because a wrong unit would
otherwise be interpreted as poor control.
"""

from math import inf, pi, radians
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geodesy import Origin, local_points
from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import (
    FieldLogError,
    Mask,
    Source,
    accepted_rows,
    check_time,
    column_names,
    read_columns,
    source_name,
)
from agrobot_mj.extensions.logs.maps import (
    HeadingColumn,
    LogMap,
    MeasuredColumn,
    PositionColumns,
    SpeedColumn,
    SteerColumn,
    ValveColumn,
    YawRateColumn,
    built_in,
    named_columns,
)
from agrobot_mj.extensions.logs.series import (
    FEWEST,
    LARGEST,
    LARGEST_YAW_RATE,
    LEAST_SPEED,
    TimeSeries,
    Values,
    course_rate,
    driven_places,
    fresh,
    in_order,
    lone,
    slope_of,
    turned_headings,
    undo_averaging,
)

SPEEDS = {"m/s": 1.0, "km/h": 1 / 3.6, "kn": 1852 / 3600, "mph": 0.44704}
ANGLES = {"deg": pi / 180, "rad": 1.0, "deg/s": pi / 180, "rad/s": 1.0}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LONGEST_GAP_S = 1.1
"""Maximum gap of an input that is bridged by interpolation [s]. Assumed value: above the interval of a receiver with 1
Hz, and shorter than a turn."""
LARGEST_STEER, LARGEST_SPEED = radians(75), 20.0
"""Maximum plausible steering angle [rad] and speed [m/s] of a tractor. Larger values indicate a wrong unit."""
LARGEST_FIELD_M = 100e3  # Maximum extent of the positions [m]. A larger extent indicates invalid fixes.
FARTHEST_M = 50e3  # Maximum east or north coordinate [m]. Coordinates of a map grid (UTM) are larger.
MOST_REPEATED = 0.1  # Fraction of repeated headings in motion above which a note reports them [-]. Assumed value.
MOST_JUMPS = 0.2  # Fraction of positions with jumps above which all positions are rejected [-]. Assumed value.


class FieldRecording(NamedTuple):
    """Recording of a machine in SI units, converted from a log with a column map."""

    name: str
    start: float  # First time at which all inputs are available [s]
    end: float  # Last time at which all inputs are available [s]
    speed: TimeSeries  # Speed along the heading of the tractor [m/s]
    wheel_speed: bool  # Whether the speed is the speed of the driven wheels, which slip
    antenna_speed: bool  # Whether the recorded speed is the speed of the recorded point (antenna), not of the rear axle
    steer: TimeSeries | None  # Wheel angle [rad], left positive
    voltage: TimeSeries | None  # Voltage of the steering valve [V]
    yaw_rate: TimeSeries | None  # Yaw rate [rad/s], left positive
    yaw_rate_source: str  # Source of the yaw rate: `gyro`, `heading`, `course`, or `none`
    heading: TimeSeries | None  # Heading from east [rad], counter-clockwise, unwrapped
    position: TimeSeries | None  # East and north coordinates of the recorded point, shape (n, 2) [m]
    notes: tuple[str, ...]  # Notes about the order of rows, and about omitted repeated and implausible values
    arm: tuple[float, float, float]
    """Position of the recorded point relative to the rear-axle centre R: ahead, to the left and up [m]."""
    inputs: dict[str, str]  # Columns of the inputs: `speed`, and `steer` or `voltage`
    signed: bool  # Whether the map declares the speed as negative in reverse

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Return the interval from `start` to `end` [s], limited to the time range of the recording. Raises
        `FieldLogError` if the result is shorter than 1 s."""
        first, last = max(start, self.start), min(end, self.end)
        if last - first < 1.0:
            raise FieldLogError(
                f"{self.name}: the log has less than one second between {start:g} and {end:g} s; it ends at "
                f"{self.end:.1f} s; check time.unit in the column map"
            )
        return first, last

    def between(self, start: float, end: float) -> "FieldRecording":
        """Return the part of the recording from `start` to `end` [s], without channels of fewer than `FEWEST` values.

        Raises `FieldLogError` if the part is shorter than 1 s, or an input has a gap.
        """
        first, last = self.bounds(start, end)
        for part, column in self.inputs.items():
            t = getattr(self, part).between(first - LONGEST_GAP_S, last + LONGEST_GAP_S).t
            gaps = np.diff(t, append=t[-1:])
            if gaps.max(initial=0.0) > LONGEST_GAP_S:
                k = int(gaps.argmax())
                raise FieldLogError(
                    f"{self.name}: {column!r} has no value from {t[k]:.2f} to {t[k + 1]:.2f} s; "
                    "select a part of the log with --from and --to"
                )
        compared = (self.yaw_rate, self.heading, self.position)
        parts = [series.between(first, last) if series else None for series in compared]
        yaw_rate, heading, position = (part if part and len(part.t) >= FEWEST else None for part in parts)
        return self._replace(start=first, end=last, yaw_rate=yaw_rate, heading=heading, position=position)


def read_recording(
    source: Source, log_map: LogMap | None, antenna_height: float, readings: bool = False
) -> FieldRecording:
    """Read a log with `log_map`, or with a suitable built-in map if `log_map` is None.

    With `readings`, the wheel angle is the raw sensor value in the unit of its column. Raises `FieldLogError` for an
    unsuitable log, `ScenarioError` if no map fits.
    """
    name = source_name(source)
    m = log_map or built_in(column_names(source), name)
    keys = named_columns(m)
    good = {
        column: accepted_rows(source, column, part.accepted, keys[column])
        for part in (m.position, m.heading)
        if part is not None and (column := part.quality)
    }
    data = read_columns(source, [column for column in keys if column not in good], keys)
    rows, t, notes = in_order(data[m.time.column] * SECONDS[m.time.unit])
    check_time(name, m.time.column, t, "time.unit of the map")
    data = {column: np.where(np.abs(each) < LARGEST, each, np.nan)[rows] for column, each in data.items()}
    good = {column: each[rows] for column, each in good.items()}
    r = _Reader(name, t - t[0], data, good, notes)
    steer = r.steer(m.steer.as_read() if readings else m.steer, inf if readings else LARGEST_STEER) if m.steer else None
    voltage = r.voltage(m.valve) if m.valve else None
    speed = r.speed(m.speed)
    heading = r.heading(m.heading, speed) if m.heading else None
    position = r.position(m.position, speed) if m.position else None
    yaw_rate, found = (r.yaw_rate(m.yaw_rate), "gyro") if m.yaw_rate else _yaw_rate_and_source(heading, position, speed)
    inputs = [series for series in (steer, voltage, speed) if series is not None]
    columns = {"speed": m.speed, "steer": m.steer, "voltage": m.valve}
    p = m.position or PositionColumns(east="x", north="y")
    return FieldRecording(
        name=name,
        start=max(series.t[0] for series in inputs),
        end=min(series.t[-1] for series in inputs),
        speed=speed,
        wheel_speed=m.speed.of == "wheel",
        antenna_speed=m.speed.of == "antenna",
        steer=steer,
        voltage=voltage,
        yaw_rate=yaw_rate,
        yaw_rate_source=found,
        heading=heading,
        position=position,
        notes=tuple(r.notes),
        arm=(p.ahead_m, p.left_m, antenna_height if p.up_m is None else p.up_m),
        inputs={part: spec.column for part, spec in columns.items() if spec is not None},
        signed=m.speed.signed,
    )


class _Reader(NamedTuple):
    """Columns of a log, with methods that convert them to time series."""

    name: str
    t: Array
    data: dict[str, Array]
    good: dict[str, Mask]  # Masks of the rows with an accepted quality, by quality column
    notes: list[str]  # Notes about omitted values

    def steer(self, c: SteerColumn, largest: float) -> TimeSeries:
        sign = 1.0 if c.positive == "left" else -1.0
        reading = sign * (self.data[c.column] - c.offset)
        reading = np.where(reading < 0, c.scale_right or c.scale, c.scale) * reading
        angle = np.arctan(c.wheelbase_m * reading) if c.wheelbase_m else ANGLES[c.unit] * reading
        series = self._finite_values("steer", c, self._without_outliers(c.column, angle), largest, "rad")
        return TimeSeries(series.t, undo_averaging(series, c.averaged_s))

    def voltage(self, c: ValveColumn) -> TimeSeries:
        return self._finite_values("valve", c, 6.0 + c.volts_per_unit * (self.data[c.column] - c.neutral))

    def speed(self, c: SpeedColumn) -> TimeSeries:
        speed = self._without_outliers(c.column, c.scale * SPEEDS[c.unit] * self.data[c.column])
        series = self._finite_values("speed", c, speed, LARGEST_SPEED, "m/s")
        if np.abs(series.value).max() < LEAST_SPEED:
            raise FieldLogError(f"{self.name}: {c.column!r} never reaches {LEAST_SPEED} m/s; use a log with motion")
        return series

    def yaw_rate(self, c: YawRateColumn) -> TimeSeries:
        sign = 1.0 if c.positive == "left" else -1.0
        rate = self._without_outliers(c.column, sign * ANGLES[c.unit] * (self.data[c.column] - c.offset))
        return self._finite_values("yaw_rate", c, rate, LARGEST_YAW_RATE, "rad/s")

    def heading(self, c: HeadingColumn, speed: TimeSeries) -> TimeSeries:
        read = self.data[c.column]
        known = read[np.isfinite(read)]
        turns_over = len(known) > 1 and np.abs(np.diff(known)).max() > 6.0 and np.ptp(known) <= 2 * pi
        if c.unit == "deg" and turns_over:
            raise FieldLogError(
                f"{self.name}: {c.column!r} wraps by 2 pi, which indicates radians; set heading.unit in the column map"
            )
        angle = ANGLES[c.unit] * (read - c.offset)
        if c.quality:
            angle[~self.good[c.quality]] = np.nan
        angle = np.angle(self._without_outliers(c.column, np.exp(1j * angle)))
        series = self._finite_values("heading", c, pi / 2 - angle if c.convention == "compass" else angle)
        found = fresh(series)
        repeated = (np.abs(np.interp(series.t, *speed)) > LEAST_SPEED) & ~np.isin(series.t, found.t)
        if repeated.mean() > MOST_REPEATED:
            self.notes.append(
                f"{repeated.sum()} repeated values of {c.column!r} (from a slow or coarse sensor) are omitted"
            )
        steady = turned_headings(found)
        jumps = len(found.t) - len(steady.t)
        if len(steady.t) < FEWEST:
            raise FieldLogError(
                f"{self.name}: {jumps} of {len(found.t)} values of {c.column!r} imply an impossible yaw rate; check "
                "heading.unit and time.unit of the map, or remove [heading] from the map"
            )
        if jumps:
            self.notes.append(f"{jumps} values of {c.column!r} that jump or are next to a jump are omitted")
        return TimeSeries(steady.t, np.unwrap(steady.value))

    def position(self, c: PositionColumns, speed: TimeSeries) -> TimeSeries:
        good, places = self._local_places(c)
        found = fresh(TimeSeries(self.t[good] - c.delay_s, places))
        settled = ~lone(found.t, found.value @ (1, 1j))
        steady = driven_places(TimeSeries(found.t[settled], found.value[settled]), speed)
        if (jumps := len(found.t) - len(steady.t)) > MOST_JUMPS * len(found.t):
            first, second = _names(c)
            raise FieldLogError(
                f"{self.name}: {jumps} of {len(found.t)} positions in {first!r} and {second!r} are farther apart than "
                "the speed allows; check these columns, or specify the quality column (position.quality)"
            )
        if jumps:
            self.notes.append(f"{jumps} positions that jump or are next to a jump are omitted")
        return steady

    def _local_places(self, c: PositionColumns) -> tuple[Mask, Array]:
        """Return a mask of the rows with accepted positions, and these positions in the local plane, shape (n, 2) [m].
        Raises `FieldLogError` for unsuitable columns."""
        first, second = _names(c)
        a, b = self.data[first], self.data[second]
        good = np.isfinite(a) & np.isfinite(b)
        if c.quality:
            good &= self.good[c.quality]
        if good.sum() < FEWEST:
            what = f" with {c.quality!r} in {list(c.accepted)}" if c.quality else ""
            fix = "check position.accepted" if c.quality else "specify other columns, or omit [position]"
            raise FieldLogError(
                f"{self.name}: {first!r} and {second!r} contain {good.sum()} positions{what}, but at least "
                f"{FEWEST} are required; {fix}"
            )
        a, b = a[good], b[good]
        if c.latitude:
            if np.abs(a).max() > 90 or np.abs(b).max() > 360:
                raise FieldLogError(
                    f"{self.name}: {first!r} and {second!r} are not in degrees; use the keys `east` and `north`"
                )
            origin = Origin(
                float(a[0]) if c.origin_lat_deg is None else c.origin_lat_deg,
                float(b[0]) if c.origin_lon_deg is None else c.origin_lon_deg,
            )
            places = local_points(origin, a, b)
        else:
            places = np.column_stack([a - c.origin_east_m, b - c.origin_north_m])
            if (away := float(np.abs(places).max())) > FARTHEST_M:
                raise FieldLogError(
                    f"{self.name}: {first!r} and {second!r} are up to {away / 1e3:.3g} km away from the origin; set "
                    f"position.origin_east_m = {a[0]:.7g} and position.origin_north_m = {b[0]:.7g} in the column map"
                )
        if not np.ptp(places, axis=0).any():
            raise FieldLogError(
                f"{self.name}: {first!r} and {second!r} are constant; specify other columns, or omit [position]"
            )
        if np.ptp(places, axis=0).max() > LARGEST_FIELD_M:
            raise FieldLogError(
                f"{self.name}: {first!r} and {second!r} span {np.ptp(places, axis=0).max() / 1e3:.3g} km; specify the "
                "quality column (position.quality) to omit rows without a fix"
            )
        return good, places

    def _without_outliers(self, column: str, values: Values) -> Values:
        """Return the values of a column with outliers replaced by NaN."""
        alone = lone(self.t, values)
        if alone.any():
            self.notes.append(f"{alone.sum()} values of {column!r} far from their neighbours are omitted")
        return np.where(alone, np.nan, values)

    def _finite_values(
        self, part: str, c: MeasuredColumn, values: Array, bound: float = inf, unit: str = ""
    ) -> TimeSeries:
        """Return the finite values of a column with latency-corrected times. Raises `FieldLogError` for fewer than
        `FEWEST` values, or for magnitudes above `bound`."""
        good = np.isfinite(values)
        if good.sum() < FEWEST:
            raise FieldLogError(f"{self.name}: {c.column!r} has only {good.sum()} values; remove [{part}] from the map")
        if (worst := float(np.abs(values[good]).max())) > bound:
            raise FieldLogError(f"{self.name}: {c.column!r} reaches {worst:.3g} {unit}; check {part}.unit of the map")
        return TimeSeries(self.t[good] - c.delay_s, values[good])


def _yaw_rate_and_source(
    heading: TimeSeries | None, position: TimeSeries | None, speed: TimeSeries
) -> tuple[TimeSeries | None, str]:
    """Return the yaw rate of a log without a gyro, and its source: the heading or, without a heading, the course. The
    course includes errors due to sideslip and tilt."""
    if heading is not None:
        return slope_of(heading), "heading"
    if position is None:
        return None, "none"
    found = course_rate(position, speed)
    return found, "course" if found is not None else "none"


def _names(c: PositionColumns) -> tuple[str, str]:
    """Return the names of the two columns that contain the position."""
    first, second = (c.latitude, c.longitude) if c.latitude else (c.east, c.north)
    return first or "", second or ""

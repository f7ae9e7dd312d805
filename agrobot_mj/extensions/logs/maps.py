"""Column maps of logs: the schema of `map.toml`, and built-in maps.

A map defines columns with their units, signs, offsets and latencies. Converted values are in SI units and radians, left
positive, in east-north-up axes. The latency of a value is the time of its row minus the time at which the value was
valid.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import Spec
from agrobot_mj.scenario.overrides import read_spec, read_toml

Delay = Annotated[float, Field(ge=-5, le=5)]
"""Latency of a value [s]; negative if the time stamps of the logger are too early."""
Name = Annotated[str, Field(min_length=1, max_length=200)]
Metres = Annotated[float, Field(ge=-1e7, le=1e7)]
Accepted = Annotated[tuple[int | str, ...], Field(min_length=1)]
Factor = Annotated[float, Field(ge=-1e6, le=1e6)]


class TimeColumn(Spec):
    """Definition of the time column in a log. Times may start at any value."""

    column: Name
    """Name of the column. Its values are numbers, or clock times with a date."""
    unit: Literal["s", "ms", "us", "ns"] = "s"
    """Unit of numeric times."""


class MeasuredColumn(Spec):
    """Definition of a column with measured values."""

    column: Name
    """Name of the column in the log."""
    delay_s: Delay = 0.0
    """Latency of the values [s]: time of the row minus the time at which the value was valid."""


class SteerColumn(MeasuredColumn):
    """Definition of the column with the wheel angle of the bicycle model."""

    unit: Literal["deg", "rad", "1/m"] = "deg"
    """Unit of the values. With 1/m, values are curvatures of the turning circle at the rear axle."""
    wheelbase_m: Annotated[float, Field(gt=0, le=20)] | None = None
    """Wheelbase for the conversion of curvatures to angles [m]."""
    positive: Literal["left", "right"] = "left"
    """Steering direction for which the column values are positive."""
    offset: Factor = 0.0
    """Column value with the wheels straight ahead [unit of the column]."""
    scale: Annotated[float, Field(gt=0, le=100)] = 1.0
    """True angle divided by the column value [-]. With `scale_right`, it applies to angles to the left only."""
    scale_right: Annotated[float, Field(gt=0, le=100)] | None = None
    """True angle divided by the column value, for angles to the right [-]. Default: `scale`."""
    averaged_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Time over which the sensor averages [s]. Add half of this time to `delay_s`."""

    @model_validator(mode="after")
    def _check_wheelbase(self) -> "SteerColumn":
        if self.unit == "1/m" and self.wheelbase_m is None:
            raise ValueError('wheelbase_m: is missing for unit = "1/m"; set the wheelbase of the vehicle [m]')
        if self.unit != "1/m" and self.wheelbase_m is not None:
            raise ValueError('wheelbase_m: applies to a curvature only; set unit = "1/m", or omit wheelbase_m')
        return self

    def as_read(self) -> "SteerColumn":
        """Return the definition for raw sensor values, which count as angles in radians or as curvatures."""
        unit = self.unit if self.unit == "1/m" else "rad"
        return self.model_copy(
            update={"unit": unit, "positive": "left", "offset": 0.0, "scale": 1.0, "scale_right": None}
        )


class ValveColumn(MeasuredColumn):
    """Definition of the column with the valve voltage, or with a signal proportional to it, for example a PWM value."""

    volts_per_unit: Factor = 1.0
    """Valve voltage (0-12 V) per unit of the column [V/unit], negative if values increase to the right."""
    neutral: Factor = 6.0
    """Column value with the valve closed [unit of the column]."""


class SpeedColumn(MeasuredColumn):
    """Definition of the column with the speed along the heading, negative in reverse."""

    unit: Literal["m/s", "km/h", "kn", "mph"] = "m/s"
    """Unit of the speed values."""
    of: Literal["ground", "antenna", "wheel"] = "ground"
    """Point whose speed is measured: rear axle over ground (radar), GNSS antenna, or driven wheels, which slip."""
    scale: Annotated[float, Field(gt=0, le=100)] = 1.0
    """True speed divided by the column value [-]."""
    signed: bool = False
    """Whether the values are negative in reverse. Use true also for a machine that never reverses."""


class YawRateColumn(MeasuredColumn):
    """Definition of the column with the yaw rate of a gyro."""

    unit: Literal["deg/s", "rad/s"] = "deg/s"
    """Unit of the yaw rate values."""
    positive: Literal["left", "right"] = "left"
    """Direction of rotation for which the column values are positive."""
    offset: Factor = 0.0
    """Column value without rotation [unit of the column]."""


class HeadingColumn(MeasuredColumn):
    """Definition of the column with the heading from two antennas or an inertial unit, not the course over ground."""

    unit: Literal["deg", "rad"] = "deg"
    """Unit of the heading values."""
    convention: Literal["compass", "enu"] = "compass"
    """Zero direction and sense of the values: `compass` from north clockwise, `enu` from east counter-clockwise."""
    offset: Factor = 0.0
    """Column value when the tractor points north (`compass`) or east (`enu`) [unit of the column]."""
    quality: Name | None = None
    """Column with the quality of the heading. Headings in rows without an `accepted` quality are omitted."""
    accepted: Accepted = (1,)
    """Values of the quality column in valid rows, as numbers or text. The value true equals 1."""


class PositionColumns(Spec):
    """Definition of the columns with the position of a tractor point: latitude and longitude, or east and north."""

    latitude: Name | None = None
    """Column of the latitude [deg], north positive."""
    longitude: Name | None = None
    """Column of the longitude [deg], east positive."""
    origin_lat_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    """Latitude of x = y = 0 [deg]. Default: latitude of the first fix."""
    origin_lon_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    """Longitude of x = y = 0 [deg]. Default: longitude of the first fix."""
    east: Name | None = None
    """Column of the east coordinate [m]."""
    north: Name | None = None
    """Column of the north coordinate [m]."""
    origin_east_m: Metres = 0.0
    """Value of `east` at x = 0 [m]."""
    origin_north_m: Metres = 0.0
    """Value of `north` at y = 0 [m]."""
    ahead_m: Metres = 0.0
    """Distance of the point ahead of the rear axle [m]."""
    left_m: Metres = 0.0
    """Distance of the point to the left of the tractor's centre line [m]."""
    up_m: Metres | None = None
    """Height of the point above level ground [m]. Default: antenna height of the scenario."""
    quality: Name | None = None
    """Column with the quality of the position solution."""
    accepted: Accepted = (4,)
    """Values of the quality column in valid rows, as numbers or text. In GGA, 4 is RTK fixed."""
    delay_s: Delay = 0.0
    """Latency of the position [s]."""

    @model_validator(mode="after")
    def _check_position_columns(self) -> "PositionColumns":
        geodetic, local = (self.latitude, self.longitude), (self.east, self.north)
        if (None in geodetic) == (None in local) or (any(geodetic) and any(local)):
            raise ValueError("latitude: specify either latitude and longitude, or east and north")
        if (self.origin_lat_deg is None) != (self.origin_lon_deg is None):
            raise ValueError("origin_lat_deg: specify both origin_lat_deg and origin_lon_deg, or neither")
        return self


def _named_columns(log_map: Spec) -> Iterator[tuple[str, str]]:
    """Yield the map keys that name a column, with the names of the columns."""
    for part, spec in log_map:
        for key in ("column", "latitude", "longitude", "east", "north", "quality"):
            if isinstance(spec, Spec) and (column := getattr(spec, key, None)):
                yield f"{part}.{key}", column


class LogMap(Spec):
    """Definition of the columns of a recording."""

    title: str = ""
    """Title of the recording."""
    time: TimeColumn
    """Name and unit of the time column in the log."""
    speed: SpeedColumn
    """Column of the speed along the heading."""
    steer: SteerColumn | None = None
    """Column of the wheel angle."""
    valve: ValveColumn | None = None
    """Column of the steering valve voltage."""
    yaw_rate: YawRateColumn | None = None
    """Column of the yaw rate from a gyro. Default: derivative of the heading or the course."""
    heading: HeadingColumn | None = None
    """Column of the heading of the tractor body."""
    position: PositionColumns | None = None
    """Columns of the position of a tractor point, usually the antenna."""

    @model_validator(mode="after")
    def _check_columns(self) -> "LogMap":
        if self.steer is None and self.valve is None:
            raise ValueError("steer: the table is missing; add [steer] for the wheel angle or [valve] for the voltage")
        if self.yaw_rate is None and self.heading is None and self.position is None:
            raise ValueError("yaw_rate: the map has no column of the motion; add [yaw_rate], [heading] or [position]")
        named = dict[str, str]()
        for key, column in _named_columns(self):
            if (other := named.setdefault(column, key)) != key:
                raise ValueError(f"{key}: {column!r} is already used for {other}; specify another column")
        return self


SIGNALS_MAP = LogMap(
    title="signals of a run without ground truth",
    time=TimeColumn(column="t"),
    steer=SteerColumn(column="steer_measured", unit="rad", delay_s=0.025, averaged_s=0.05),
    valve=ValveColumn(column="valve_voltage"),
    speed=SpeedColumn(column="speed_hat"),
    position=PositionColumns(east="gnss_x", north="gnss_y", quality="gnss_quality", accepted=(2,)),
)
"""Built-in column map for `signals.parquet`: sensor measurements, estimated speed, and valve voltage."""
GYRO_MAP = SIGNALS_MAP.model_copy(update={"yaw_rate": YawRateColumn(column="gyro", unit="rad/s")})
"""Built-in column map for the `signals.parquet` of a run with a gyro."""
AGOPENGPS_MAP = LogMap(
    title="CSV in the units and signs of the AgOpenGPS family",
    time=TimeColumn(column="time_s"),
    steer=SteerColumn(column="steer_angle_deg", positive="right"),
    speed=SpeedColumn(column="speed_km_h", unit="km/h", of="antenna"),
    position=PositionColumns(latitude="latitude", longitude="longitude", quality="fix_quality"),
)
"""Built-in column map for the CSV format in docs/extensions/logs/replay.md: right positive, km/h, quality as in GGA."""
BUILT_IN = (GYRO_MAP, SIGNALS_MAP, AGOPENGPS_MAP)
"""Built-in column maps, in order of preference for a log without a column map."""
UNKNOWN = "the columns are unknown; describe their meaning with --map map.toml"


def read_map(path: Path) -> LogMap:
    """Read a column map from a TOML file. Raises `ScenarioError` with all errors of the file."""
    return read_spec(LogMap, read_toml(path), path.name)


def built_in(names: Sequence[str], log: str) -> LogMap:
    """Return the first column map of `BUILT_IN` whose columns are all in `names`. Raises `ScenarioError` if no map
    fits."""
    if (found := known_map(names)) is None:
        raise ScenarioError(f"{log}: {UNKNOWN}")
    return found


def known_map(names: Sequence[str]) -> LogMap | None:
    """Return the first column map of `BUILT_IN` whose columns are all in `names`, or None if no column map fits."""
    return next((each for each in BUILT_IN if set(named_columns(each)) <= set(names)), None)


SI_TABLES: tuple[tuple[str, tuple[str, ...], dict[str, Any]], ...] = (
    ("steer", ("steer",), {"column": "steer", "unit": "rad"}),
    ("steer", ("was",), {"column": "was"}),
    ("speed", ("speed",), {"column": "speed"}),
    ("speed", ("wheel_speed",), {"column": "wheel_speed", "of": "wheel"}),
    ("yaw_rate", ("yaw_rate",), {"column": "yaw_rate", "unit": "rad/s"}),
    ("heading", ("heading",), {"column": "heading", "unit": "rad", "convention": "enu"}),
    ("position", ("latitude", "longitude"), {"latitude": "latitude", "longitude": "longitude"}),
    ("position", ("east", "north"), {"east": "east", "north": "north"}),
)
"""Column-map tables for logs in SI units: name, required columns and keys. The first suitable entry of each name
applies."""
INSTEAD = {
    "steer_demand": "the commanded angle; the residuals then include the lag of the steering",
    "curvature": 'with unit = "1/m" and wheelbase_m',
    "steering_wheel": "the angle of the steering wheel, with scale = wheel angle / steering-wheel angle",
}
"""Columns that a user-defined column map may use in place of a measured wheel angle, with instructions for the user."""


def si_tables(names: Sequence[str], changed: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the map tables for a log in SI units with the columns `names`. `changed` contains, for each table, the
    keys that differ from their defaults."""
    found: dict[str, dict[str, Any]] = {"time": {"column": "t"}}
    for table, needed, keys in SI_TABLES:
        if table not in found and set(needed) <= set(names):
            found[table] = {**keys, **changed.get(table, {})}
    if "position" in found and "quality" in names:
        found["position"]["quality"] = "quality"
    return found


def lacking(tables: Iterable[str], names: Sequence[str]) -> str:
    """Return a text that names the quantities missing for a replay, or an empty string if none is missing."""
    there = set(tables)
    lacks = [] if there & {"steer", "valve"} else ["no wheel angle"]
    lacks += [] if "speed" in there else ["no speed"]
    lacks += [] if there & {"yaw_rate", "heading", "position"} else ["no yaw rate, heading or position to compare with"]
    others = [f"; [steer] of a map can use column {name}, {what}" for name, what in INSTEAD.items() if name in names]
    if not lacks:
        return ""
    return f"the log has {' and '.join(lacks)}" + "".join(others if "no wheel angle" in lacks else [])


def named_columns(log_map: LogMap) -> dict[str, str]:
    """Return the map key of each column, by column name."""
    return {column: key for key, column in _named_columns(log_map)}

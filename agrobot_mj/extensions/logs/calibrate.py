"""Calibration of the sensors of a log: centre, scale and sign of the steering, latencies, mounting, antenna position.

One fit estimates them together with tyre slip and steering play (`identify.fit`) under priors, so that parameters not
excited by slow driving get wider intervals and do not bias the others. The wheelbase is assumed to be known: slow
driving identifies only scale divided by wheelbase. Latencies are relative to the rows of the steering or, if present,
to those of the gyro.

The initial value is a line through the measurements (`rough_steering`): wheels without slip turn by atan(L r / u), and
this angle, from the yaw rate, is regressed on the sensor reading at the latency that explains most.
"""

from collections.abc import Mapping, Sequence
from math import exp, hypot, inf, pi, radians, sqrt
from typing import Literal, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Source, column_names, source_name
from agrobot_mj.extensions.logs.identify.fit import DELAY_S, VehicleFit, fit, priors
from agrobot_mj.extensions.logs.identify.model import Chassis2
from agrobot_mj.extensions.logs.identify.windows import PARAMETERS, WINDOW_S, VehicleData, enough
from agrobot_mj.extensions.logs.maps import LogMap, SteerColumn, built_in
from agrobot_mj.extensions.logs.pieces import (
    CHORD_S,
    SLIPPED,
    TWO_SPEEDS,
    Pieces,
    check_columns,
    read_pieces,
    slow_and_fast,
    split,
)
from agrobot_mj.extensions.logs.quantities import Quantity, half_width
from agrobot_mj.extensions.logs.recording import ANGLES, FieldRecording
from agrobot_mj.extensions.logs.replay.residuals import moving
from agrobot_mj.extensions.logs.series import TimeSeries, chords
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.sensors.dual_antenna import DualAntenna

AGES_S = np.arange(-0.5, 1.5, 0.02)
"""Ages of the yaw rate behind the steering that are tried [s]."""
LEAST_EXPLAINED = 0.5
"""Fraction of the variance of the angle that a straight line must explain [-]. Assumed value: sensors give > 0.9."""
LEAST_SAMPLES = 50
"""Minimum number of yaw rates."""
OUTLIER = 3.0
"""Distance from the line divided by a robust standard deviation above which a sample is an outlier [-]."""


class RoughSteering(NamedTuple):
    """Straight line between readings and wheel angle."""

    centre: float
    """Reading straight ahead [in the sensor's unit]."""
    scale: float
    """Wheel angle per reading, negative where readings grow to the right [rad per unit]."""
    age: float
    """Age of the yaw rate [s]."""
    explained: float
    """Fraction of the variance explained [-]."""

    def angle(self, recording: FieldRecording) -> FieldRecording:
        """Return a recording of readings as one of angles."""
        assert recording.steer is not None
        t, reading = recording.steer
        return recording._replace(steer=TimeSeries(t, self.scale * (reading - self.centre)))


def rough_steering(pieces: Sequence[FieldRecording], wheelbase: float) -> RoughSteering:
    """Regress the turn angle of segments on their readings. Raises `FieldLogError` if there is no line."""
    found = [part for part in (_turning(piece, wheelbase) for piece in pieces) if part is not None]
    name = pieces[0].name
    if sum(len(angle) for _, angle, _ in found) < LEAST_SAMPLES:
        raise FieldLogError(f"{name}: has hardly a yaw rate, heading or position at speed; name one in the map")
    angle, weight = (np.concatenate([part[k] for part in found]) for k in (1, 2))
    best = max(
        (_line(np.concatenate([part[0][k] for part in found]), angle, weight, float(age)))
        for k, age in enumerate(AGES_S)
    )
    if best[0] < LEAST_EXPLAINED:
        raise FieldLogError(
            f"{name}: a straight line through the readings of the steering explains {100 * max(best[0], 0):.0f} % of "
            "its turning; is [steer] the wheel angle, and does the log have bends to both sides?"
        )
    explained, scale, centre, age = best
    return RoughSteering(centre, scale, age, explained)


def _turning(piece: FieldRecording, wheelbase: float) -> tuple[Array, Array, Array] | None:
    """Return the readings at each age (ages, n), wheel angle without slip (n,) and weight (n,) of a segment; None
    without any."""
    assert piece.steer is not None
    if piece.yaw_rate is None or len((seen := moving(piece, piece.yaw_rate)).t) < 2:
        return None
    u = np.interp(seen.t, piece.speed.t, piece.speed.value)
    read = np.array([np.interp(seen.t - age, *piece.steer) for age in AGES_S])
    angle = np.arctan(wheelbase * seen.value / u)
    return read, angle, np.abs(u) * np.cos(angle) ** 2  # a yaw rate's noise is that of the angle over u cos2


def _line(reading: Array, angle: Array, weight: Array, age: float) -> tuple[float, float, float, float]:
    """Return the fraction explained by a line, its slope, its reading at zero, and the latency; outliers removed
    once."""
    kept = np.ones(len(angle), dtype=bool)
    for _ in range(2):
        if np.ptp(reading[kept]) == 0.0:
            return 0.0, 1.0, 0.0, age
        slope, level = np.polyfit(reading[kept], angle[kept], 1, w=weight[kept])
        off = weight * (angle - slope * reading - level)
        kept = np.abs(off) < OUTLIER * 1.4826 * np.median(np.abs(off)) + 1e-12
    spread = weight * (angle - np.average(angle, weights=weight**2))
    return 1.0 - float((off**2).sum() / (spread**2).sum()), float(slope), float(-level / slope), age


TYRES = ("front_compliance", "rear_compliance", "front_relaxation_m", "rear_relaxation_m", "backlash")
AT_THE_EDGE = 0.97
"""Fraction of the maximum age that is looked for from which it may be larger [-]."""
LEAST_WINDOWS = 3
"""Windows that a calibration needs: a quarter of a minute at speed."""
SEEN_IN_SPEED = 0.9
"""Minimum common fraction of the variance of recorded speed and positions for identifying a latency [-]."""
SURE = {"ahead_m": 0.25, "left_m": 0.25, "delay_s": 0.15, "offset": inf, "scale": inf}
"""Half width of an interval above which a quantity counts as not identified [unit of the key]. Assumed values."""
BENDS_RAD = radians(2.5)
"""Minimum standard deviation of the wheel angle for identifying latencies and positions [rad]. Assumed value: for
wheels without slip, corrections of 0.7 deg along a line give an antenna 0.13 m too far behind, bends of 3 deg 0.016
m."""
LAG_OF_TYRES_S = 0.025
"""Half the interval of the undetected contribution of tyre lag to a latency [s]. Assumed value (other models)."""
ONE_SPEED = 3.0
"""Factor on the intervals of a drive at one speed, where scale, tyres and antenna are confounded [-]. Assumed value,
from independent models."""


class _Drive(NamedTuple):
    """Limits of identifiability of a drive, independent of its fit."""

    wander: float
    """Half the interval of what two antennas wander [rad]."""
    bends: bool
    """Whether ages and places show."""
    steady: bool
    """Whether it has one speed."""


class Calibration(NamedTuple):
    """Calibration of the sensors of a log, with vehicle parameters."""

    found: dict[str, Quantity]
    """Quantities by the keys of the map, in its units."""
    log_map: LogMap
    pieces: Pieces
    """The recordings in radians, by the rough centre and scale."""
    rough: RoughSteering
    data: VehicleData
    fit: VehicleFit
    """Estimated values, in addition to `rough` and the map."""
    centres: tuple[float, ...]
    """Reading straight ahead in the first half and in the second [in the sensor's unit]."""

    @property
    def steer(self) -> SteerColumn:
        """The steering of the map that the log came with."""
        assert self.log_map.steer is not None
        return self.log_map.steer

    @property
    def positive(self) -> Literal["left", "right"]:
        """Side to which the readings grow."""
        return "left" if self.rough.scale > 0 else "right"

    @property
    def units(self) -> dict[str, str]:
        """Units of the estimated quantities, if those of the map."""
        units = {"steer.scale": f"{self.steer.unit} per reading"}
        return units | ({"heading.offset": self.log_map.heading.unit} if self.log_map.heading else {})

    @property
    def centre_error(self) -> float:
        """Wheel angle at straight ahead according to the map, left positive [rad]."""
        scale = self.rough.scale * self.fit.values["steer_scale"]
        return scale * (self.steer.offset - self.found["steer.offset"].value)

    @property
    def heading_error(self) -> float | None:
        """Angle of the recorded heading to the left of the true one [rad]; None if not identifiable."""
        return self.fit.values.get("heading_offset")

    @property
    def largest_angle(self) -> float:
        """Maximum wheel angle, in both directions [rad]."""
        scale, offset = self.fit.values["steer_scale"], self.fit.values["steer_offset"]
        return max(float(np.abs(scale * piece.steer - offset).max()) for piece in self.data.pieces)

    @property
    def calibrated(self) -> LogMap:
        """Return the map with the estimated values; quantities that are not identifiable stay."""
        told = {key: each.rounded for key, each in self.found.items() if each.identified}
        return changed_map(self.log_map, {**told, "steer.positive": self.positive})


def calibrate(
    sources: Sequence[Source], log_map: LogMap | None, scenario: Scenario, start_s: float = 0.0, end_s: float = inf
) -> Calibration:
    """Calibrate the sensors of logs under one map; the wheelbase is the scenario's. Raises `FieldLogError`."""
    m = steered_map(sources[0], log_map)
    cut = read_pieces(sources, m, scenario.tractor.antenna_height_m, start_s, end_s, readings=True)
    return calibrated(cut, m, scenario)


def steered_map(source: Source, log_map: LogMap | None) -> LogMap:
    """Return the map, or a shipped one. Raises `FieldLogError` for a map without a wheel angle."""
    m = log_map or built_in(column_names(source), source_name(source))
    if m.steer is None:
        raise FieldLogError(f"{source_name(source)}: its map has no [steer]; name the column of the wheel angle")
    return m


def calibrated(cut: Pieces, log_map: LogMap, scenario: Scenario) -> Calibration:
    """Return the calibration of segments whose wheel angle is what its sensor reads. Raises `FieldLogError`."""
    t = scenario.tractor
    check_columns(cut.kept)
    rough = rough_steering(cut.kept, t.wheelbase_m)
    angles = tuple(rough.angle(piece) for piece in cut.kept)
    chassis = Chassis2(t.mass_kg, t.yaw_inertia_kg_m2, t.cg_to_front_axle, t.cg_to_rear_axle, False)
    data = enough(angles, chassis, LEAST_WINDOWS)
    result = fit(data, _names(data), priors(t, rough.age))
    if not 1 / SLIPPED < (more := result.values["steer_scale"]) < SLIPPED:
        raise FieldLogError(
            f"{angles[0].name}: tyres that slip ask for {more:.2g} times the steering of a line through its readings; "
            "is [steer] the wheel angle, are the columns of [steer] and [yaw_rate] not exchanged, and do its bends go "
            "well beyond its play?"
        )
    for part in ("steer", "heading", "position", "speed"):
        if abs(age := result.values.get(f"{part}_delay_s", 0.0)) > AT_THE_EDGE * PARAMETERS[f"{part}_delay_s"].high:
            raise FieldLogError(
                f"{angles[0].name}: the latency of [{part}] is at the edge of its range, {age:+.1f} s from the map's; "
                f"set {part}.delay_s nearer to it and calibrate again"
            )
    slow, fast = slow_and_fast(cut.kept)
    drive = _Drive(_wander(data), _spread(angles) > BENDS_RAD, fast < TWO_SPEEDS * slow)
    found = _found(result, rough, log_map, drive)
    centres = tuple(_centre(half, t.wheelbase_m, rough) for half in split(cut.kept, 0.5))
    return Calibration(found, log_map, cut._replace(kept=angles), rough, data, result, centres)


def _spread(angles: Sequence[FieldRecording]) -> float:
    """Return the standard deviation of the wheel angle [rad]."""
    return float(np.std(np.concatenate([each.steer.value for each in angles if each.steer is not None])))


def _centre(kept: Sequence[FieldRecording], wheelbase: float, rough: RoughSteering) -> float:
    """Return the mean reading straight ahead of segments, by the slope of all [in the sensor's unit]."""
    k = int(np.abs(AGES_S - rough.age).argmin())
    found = [part for piece in kept if (part := _turning(piece, wheelbase)) is not None]
    read, angle, weight = np.concatenate([np.stack([part[0][k], *part[1:]]) for part in found], axis=1)
    return float(np.average(read - angle / rough.scale, weights=weight**2))


def _names(data: VehicleData) -> tuple[str, ...]:
    """Return the parameters of the fit: ages against the gyro or else the steering."""
    channels = set(data.channels)
    ages = {"steer_delay_s": "yaw_rate", "heading_delay_s": "heading", "position_delay_s": "position"}
    if _speed_explained([piece.recording for piece in data.pieces]) > SEEN_IN_SPEED:
        ages |= {"speed_delay_s": "position"}
    place = ("ahead_m", "left_m") if "position" in channels else ()
    return ("steer_offset", "steer_scale", *(age for age, needs in ages.items() if needs in channels), *place, *TYRES)


def _speed_explained(recordings: Sequence[FieldRecording]) -> float:
    """Return the fraction of the variance of the ways between positions that the recorded speed explains at the age
    that does best.

    A speed that hardly changes leaves the noise of both, which would be laid on each other at any age.
    """
    ways = [_ways(each.position, each.speed) for each in recordings if each.position and len(each.position.t)]
    if not ways:
        return 0.0
    driven, *said = np.concatenate(ways, axis=1)
    return max(float(np.corrcoef(driven, each)[0, 1]) ** 2 if np.ptp(each) > 0 else 0.0 for each in said)


def _ways(position: TimeSeries, speed: TimeSeries) -> Array:
    """Return the ways in steps of `chords`: between positions, and by the speed of each age, shape (1 + ages, n)
    [m]."""
    t, chord = chords(position, CHORD_S)
    way = cumulative_trapezoid(np.abs(speed.value), speed.t, initial=0)
    return np.stack([chord, *(np.diff(np.interp(t - age, speed.t, way)) for age in AGES_S)])


def _found(result: VehicleFit, rough: RoughSteering, m: LogMap, drive: _Drive) -> dict[str, Quantity]:
    """Return the quantities of the map from those of the fit."""
    value, index = result.values, {name: k for k, name in enumerate(result.names)}
    assert m.steer is not None
    s, o, k = value["steer_scale"], value["steer_offset"], rough.scale
    # a curvature is read as its angle
    unit, per = ANGLES.get(m.steer.unit, 1.0), 1.0 / (m.steer.wheelbase_m or 1.0)
    # true angle = s k (reading - rough centre) - o
    slopes = {"steer_offset": per / (s * k), "steer_scale": -per * o / (s * s * k)}
    found: dict[str, tuple[float, dict[str, float]]] = {
        "steer.offset": (per * (rough.centre + o / (s * k)), slopes),
        "steer.scale": (abs(s * k) / unit, {"steer_scale": abs(k) / unit}),
    }
    if "steer_delay_s" in index:
        found["steer.delay_s"] = (m.steer.delay_s - value["steer_delay_s"], {"steer_delay_s": 1.0})
    if m.heading is not None and "heading_delay_s" in index:
        found["heading.delay_s"] = (m.heading.delay_s + value["heading_delay_s"], {"heading_delay_s": 1.0})
        if "heading_offset" in index:
            sign = (-1.0 if m.heading.convention == "compass" else 1.0) / ANGLES[m.heading.unit]
            turn = (m.heading.offset + sign * value["heading_offset"] + pi * abs(sign)) % (2 * pi * abs(sign))
            found["heading.offset"] = (turn - pi * abs(sign), {"heading_offset": sign})
    if m.position is not None and "position_delay_s" in index:
        found["position.delay_s"] = (m.position.delay_s + value["position_delay_s"], {"position_delay_s": 1.0})
        found["speed.delay_s"] = (m.speed.delay_s + value.get("speed_delay_s", 0.0), {"speed_delay_s": 1.0})
        for key in ("ahead_m", "left_m"):
            found[f"position.{key}"] = (getattr(m.position, key) + value[key], {key: 1.0})
    return {key: _quantity(key, middle, slopes, result, index, drive) for key, (middle, slopes) in found.items()}


def _wander(data: VehicleData) -> float:
    """Return half the interval of the mean drift of two antennas in a log [rad], which cannot be distinguished from
    their mounting.

    The mean of a first-order process over T time constants has 2 / T (1 - (1 - e^-T) / T) of its variance.
    """
    if "heading" not in data.channels:
        return 0.0
    antennas = DualAntenna()
    T = data.windows * WINDOW_S / antennas.wander_time_s
    return 2.0 * sqrt(2 / T * (1 - (1 - exp(-T)) / T)) * antennas.wander_sigma_m / antennas.baseline_m


def _quantity(
    key: str, middle: float, slopes: dict[str, float], result: VehicleFit, index: dict[str, int], drive: _Drive
) -> Quantity:
    """Return a quantity with its interval, from its derivatives with respect to the fit parameters and the limits of
    the drive."""
    if not slopes.keys() <= index.keys():  # an age that the log cannot tell was left out of the fit
        return Quantity(middle, middle - 2 * DELAY_S, middle + 2 * DELAY_S, False)
    gradient = np.zeros(len(index))
    for name, slope in slopes.items():
        gradient[index[name]] = slope
    half, name = half_width(result.covariance, gradient, result.freedom), key.partition(".")[2]
    half = hypot(half, slopes.get("heading_offset", 0.0) * drive.wander)
    if name != "offset" and drive.steady:
        half *= ONE_SPEED
    if name == "delay_s":
        half = hypot(half, LAG_OF_TYRES_S)
    told = half < SURE[name] and (drive.bends or name in ("offset", "scale"))
    return Quantity(middle, middle - half, middle + half, told)


def changed_map(m: LogMap, values: Mapping[str, float | str]) -> LogMap:
    """Return a map with other values by `table.key`."""
    tables: dict[str, dict[str, float | str]] = {}
    for key, value in values.items():
        table, _, name = key.partition(".")
        tables.setdefault(table, {})[name] = value
    return m.model_copy(update={name: getattr(m, name).model_copy(update=each) for name, each in tables.items()})

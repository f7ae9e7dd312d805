"""Calibration of the sensors of a log: steering centre, scale and sign, latencies, heading offset and antenna position.

One fit estimates all of these quantities together with tyre slip and steering play (`identify.fit`). Because of priors,
parameters that slow driving does not excite have wide intervals and do not bias other parameters. The wheelbase must be
known, because slow driving identifies only the steering scale divided by the wheelbase. Latencies are relative to the
gyro or, without a gyro, to the steering.

Initial values come from a regression without slip (`steering`), which also detects different left and right scales.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import exp, hypot, inf, pi, radians, sqrt
from typing import Literal, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Source, column_names, source_name
from agrobot_mj.extensions.logs.checks import CHORD_S, SLIPPED, check_columns
from agrobot_mj.extensions.logs.identify.fit import DELAY_S, Prior, VehicleFit, fit, priors
from agrobot_mj.extensions.logs.identify.model import Chassis2
from agrobot_mj.extensions.logs.identify.predictions import PARAMETERS, true_wheel_angles
from agrobot_mj.extensions.logs.identify.windows import WINDOW_S, VehicleData, enough
from agrobot_mj.extensions.logs.maps import LogMap, SteerColumn, built_in
from agrobot_mj.extensions.logs.pieces import (
    TWO_SPEEDS,
    Pieces,
    read_pieces,
    slow_and_fast,
    split_at,
)
from agrobot_mj.extensions.logs.quantities import Quantity, half_width
from agrobot_mj.extensions.logs.recording import ANGLES, FieldRecording
from agrobot_mj.extensions.logs.replay.scrub import scrub
from agrobot_mj.extensions.logs.series import TimeSeries, chords
from agrobot_mj.extensions.logs.steering import (
    AGES_S,
    RoughSteering,
    SteeringCentre,
    centre_of,
    centres_differ,
    rough_steering,
)
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.sensors.dual_antenna import DualAntenna

TYRES = ("front_compliance", "rear_compliance", "front_relaxation_m", "rear_relaxation_m", "backlash")
AT_THE_EDGE = 0.97
"""Maximum ratio of an estimated latency to the limit of its search range in a valid calibration [-]."""
LEAST_WINDOWS = 3  # Minimum number of 5 s windows with the machine in motion for a calibration
SEEN_IN_SPEED = 0.9  # Minimum squared correlation of distances from speed and positions for fitting the speed latency
SURE = {"ahead_m": 0.25, "left_m": 0.25, "delay_s": 0.2, "offset": inf, "scale": inf, "scale_right": inf}
"""Maximum half width of the 95 % interval of an identified quantity, by the last part of its map key [m or s]. The
value `inf` means no limit. Assumed values."""
SURE_HEADING_RAD = radians(5.0)
"""Maximum half width of the 95 % interval of an identified heading offset [rad]. The limit applies only if the interval
includes the offset in the column map. Assumed value."""
BENDS_RAD = radians(2.5)
"""Minimum standard deviation of the wheel angle at which latencies and antenna positions are identifiable [rad].
Assumed value: without slip, the error of the antenna position is 0.13 m at steering angles of 0.7 deg, and 0.016 m
at 3 deg."""
TWO_SIGMA = 2.0  # Minimum difference between left and right steering scale, divided by its standard error [-]
RIGHT_SIGMA = 0.3  # Prior standard deviation of the right steering scale divided by the left steering scale [-]
ONE_SPEED = 3.0
"""Factor by which intervals are widened if the machine drives at one speed throughout the log [-]. With one speed,
errors of steering scale, tyre parameters and antenna position cannot be separated. Assumed value."""
SCRUB, SCRUB_HALF = 0.6, 0.8
"""Mean, and half width of the interval, of the yaw-rate loss due to tyre scrub, divided by the loss of the simulated
tyres [-]. From the simulator, for 0.4 to 1.6 times the lateral compliance of the scenario, with and without a scrubbing
moment."""


class _Lag(NamedTuple):
    """Effect of dynamics that the fit does not model, on a fitted latency [s] or distance [m]."""

    mean: float
    half: float  # Half width of the 95 % interval

    def times(self, factor: float) -> "_Lag":
        """Return the effect multiplied by a factor."""
        return _Lag(self.mean * factor, self.half * factor)


LAGS = {
    "steer.delay_s": _Lag(-0.002, 0.018),
    "heading.delay_s": _Lag(-0.002, 0.002),
    "position.delay_s": _Lag(-0.01, 0.027),
    "speed.delay_s": _Lag(-0.01, 0.027),
}
"""Effects on the latencies relative to a gyro, due to linkage, tyres and body roll [s]. The values of this and the
following constants are means and spreads of calibrations of 100 simulated machines."""
AHEAD_S = _Lag(-0.001, 0.012)  # Effect on the distance of the antenna ahead, divided by the speed [s]
WHEEL_S2_M = _Lag(-1 / 60, 1 / 60)
"""Effect of slip of accelerating wheels on the latency of a wheel speed, divided by the speed [s2/m]."""


class _Drive(NamedTuple):
    """Properties of the motion in a log that determine which parameters are identifiable."""

    wander: float  # Half width of the interval for the mean drift of a dual-antenna heading [rad]
    bends: bool  # Whether the steering moves enough to identify latencies and antenna positions
    steady: bool  # Whether the machine drives at one speed throughout the log
    scrub: float  # Fraction of the yaw rate that scrubbing tyres lose in slow bends [-]
    gyro: bool  # Whether latencies are relative to a gyro; otherwise, they are relative to the steering
    speed: float  # Mean of slow and fast speed [m/s]
    wheel_speed: bool  # Whether the recorded speed is the speed of the driven wheels

    def lags(self, key: str) -> Iterator[_Lag]:
        """Yield the effects of dynamics that are not modelled on the quantity of a map key."""
        if key in LAGS:
            yield LAGS[key]
        if key in LAGS and key != "steer.delay_s" and not self.gyro:
            steering = LAGS["steer.delay_s"]  # the latency of the steering relative to a gyro
            yield steering._replace(mean=-steering.mean)
        if key == "speed.delay_s" and self.wheel_speed:
            yield WHEEL_S2_M.times(self.speed)
        if key == "position.ahead_m":
            yield AHEAD_S.times(self.speed)


class Calibration(NamedTuple):
    """Calibration of the sensors of a log, together with the fitted vehicle parameters."""

    found: dict[str, Quantity]  # Calibrated quantities by key of the column map, for example `steer.offset`
    log_map: LogMap
    pieces: Pieces  # Usable segments of the log, with wheel angles computed by `rough` [rad]
    rough: RoughSteering
    data: VehicleData
    fit: VehicleFit  # Fitted vehicle and sensor parameters, relative to `rough` and to the column map
    centres: tuple[SteeringCentre, ...]
    """Steering centres in the first and the second half of the log, without unidentified centres."""

    @property
    def steer(self) -> SteerColumn:
        """Definition of the wheel-angle column in the column map before calibration."""
        assert self.log_map.steer is not None
        return self.log_map.steer

    @property
    def positive(self) -> Literal["left", "right"]:
        """Steering direction in which the raw sensor values increase."""
        return "left" if self.rough.scale > 0 else "right"

    @property
    def units(self) -> dict[str, str]:
        """Units of the calibrated quantities whose unit depends on the column map, by map key."""
        units = dict.fromkeys(("steer.scale", "steer.scale_right"), f"{self.steer.unit} per reading")
        return units | ({"heading.offset": self.log_map.heading.unit} if self.log_map.heading else {})

    @property
    def centre_error(self) -> float:
        """True wheel angle where the original column map gives straight ahead [rad], positive to the left."""
        scale = self.rough.scale * self.fit.values["steer_scale"]
        return scale * (self.steer.offset - self.found["steer.offset"].value)

    @property
    def heading_error(self) -> float | None:
        """Angle from the true to the recorded heading [rad], positive to the left, or None if not identified."""
        return self.fit.values.get("heading_offset")

    @property
    def two_scales(self) -> bool:
        """Whether the steering scales to the left and to the right differ significantly."""
        right, error = (each.get("steer_right") for each in (self.fit.values, self.fit.errors))
        return right is not None and error is not None and abs(right - 1.0) > TWO_SIGMA * error

    @property
    def largest_angle(self) -> float:
        """Maximum absolute wheel angle in the log after calibration [rad]."""
        return max(float(np.abs(true_wheel_angles(self.fit.values, piece.steer)).max()) for piece in self.data.pieces)

    @property
    def calibrated(self) -> LogMap:
        """Copy of the column map with the identified quantities and the sign of the steering sensor."""
        told = {key: each.rounded for key, each in self.found.items() if each.identified}
        return changed_map(self.log_map, {**told, "steer.positive": self.positive})


def calibrate(
    sources: Sequence[Source], log_map: LogMap | None, scenario: Scenario, start_s: float = 0.0, end_s: float = inf
) -> Calibration:
    """Calibrate the sensors of one machine from logs with a common column map. The scenario gives the wheelbase.

    Raises `FieldLogError` for unsuitable logs.
    """
    m = steered_map(sources[0], log_map)
    cut = read_pieces(sources, m, scenario.tractor.antenna_height_m, start_s, end_s, readings=True)
    return calibrate_log(cut, m, scenario)


def steered_map(source: Source, log_map: LogMap | None) -> LogMap:
    """Return `log_map` or, if it is None, the built-in column map for the columns of the log. Raises `FieldLogError` if
    the column map has no wheel angle."""
    m = log_map or built_in(column_names(source), source_name(source))
    if m.steer is None:
        raise FieldLogError(f"{source_name(source)}: the map has no [steer]; add it with the column of the wheel angle")
    return m


def _is_plausible(ratio: float) -> bool:
    """Return whether the ratio of two steering scales is plausible."""
    return 1 / SLIPPED < ratio < SLIPPED


def calibrate_log(cut: Pieces, log_map: LogMap, scenario: Scenario) -> Calibration:
    """Calibrate the sensors of a log from its segments, in which the wheel angles are raw sensor values. Raises
    `FieldLogError` for unsuitable logs."""
    t = scenario.tractor
    check_columns(cut.kept)
    rough = rough_steering(cut.kept, t.wheelbase_m)
    angles = tuple(rough.angle(piece) for piece in cut.kept)
    chassis = Chassis2(t.mass_kg, t.yaw_inertia_kg_m2, t.cg_to_front_axle, t.cg_to_rear_axle, False)
    data = enough(angles, chassis, LEAST_WINDOWS)
    known = priors(t, rough.age) | {"steer_right": Prior(rough.right, RIGHT_SIGMA)}
    centres = tuple(
        centre for half in split_at(cut.kept, 0.5) if (centre := centre_of(half, t.wheelbase_m, rough)) is not None
    )
    moves = centres_differ(centres, rough)
    # a centre that moves resembles two scales
    sides = ("steer_right",) if rough.right != 1.0 or not moves else ()
    result = fit(data, (*_names(data), *sides), known)
    if rough.right == 1.0 and not _is_plausible(result.values.get("steer_right", 1.0)):
        result = fit(data, _names(data), known)  # the log is too short for separate scales
    left = result.values["steer_scale"]
    for more in (left, left * result.values.get("steer_right", rough.right) / rough.right):
        if not _is_plausible(more):
            raise FieldLogError(
                f"{angles[0].name}: a model with tyre slip requires {more:.2g} times the steering angle of a model "
                "without slip, which is not plausible; check that [steer] is the wheel angle, that the columns of "
                "[steer] and [yaw_rate] are not swapped, and that the wheel angle in bends exceeds the steering play"
            )
    for part in ("steer", "heading", "position", "speed"):
        if abs(age := result.values.get(f"{part}_delay_s", 0.0)) > AT_THE_EDGE * PARAMETERS[f"{part}_delay_s"].high:
            raise FieldLogError(
                f"{angles[0].name}: the latency of [{part}] is at the limit of its search range, {age:+.1f} s from "
                f"the value in the column map; set {part}.delay_s closer to the true value and calibrate again"
            )
    slow, fast = slow_and_fast(cut.kept)
    bends, gyro = _steering_deviation(angles) > BENDS_RAD, "yaw_rate" in data.channels
    wander = _wander(data, scenario.sensors.gnss.dual_antenna)
    steady, mean = fast < TWO_SPEEDS * slow, (slow + fast) / 2
    drive = _Drive(wander, bends, steady, scrub(scenario), gyro, mean, log_map.speed.of == "wheel")
    found = _quantities_of_fit(result, rough, log_map, drive)
    if moves:  # the fit assumes a constant centre; latencies compensate for the difference
        found |= {
            key: each._replace(identified=False)
            for key, each in found.items()
            if key == "steer.offset" or key.endswith(".delay_s")
        }
    return Calibration(found, log_map, cut._replace(kept=angles), rough, data, result, centres)


def _steering_deviation(angles: Sequence[FieldRecording]) -> float:
    """Return the standard deviation of the wheel angle over all segments [rad]."""
    return float(np.std(np.concatenate([each.steer.value for each in angles if each.steer is not None])))


def _names(data: VehicleData) -> tuple[str, ...]:
    """Return the names of the parameters to fit, which depend on the measured channels. Latencies are relative to the
    gyro or, without a gyro, to the steering."""
    channels = set(data.channels)
    ages = {"steer_delay_s": "yaw_rate", "heading_delay_s": "heading", "position_delay_s": "position"}
    if _speed_explained([piece.recording for piece in data.pieces]) > SEEN_IN_SPEED:
        ages |= {"speed_delay_s": "position"}
    place = ("ahead_m", "left_m", "lean_s2") if "position" in channels else ()
    return (
        "steer_offset",
        "steer_scale",
        *(age for age, needs in ages.items() if needs in channels),
        *place,
        *TYRES,
    )


def _speed_explained(recordings: Sequence[FieldRecording]) -> float:
    """Return the fraction of the variance in distances between positions that the recorded speed explains [-].

    The fraction is the maximum over the speed latencies `AGES_S`. At nearly constant speed, noise dominates the
    variance and the fraction is low. The fraction is 0 without positions.
    """
    ways = [_ways(each.position, each.speed) for each in recordings if each.position and len(each.position.t)]
    if not ways:
        return 0.0
    driven, *said = np.concatenate(ways, axis=1)
    return max(float(np.corrcoef(driven, each)[0, 1]) ** 2 if np.ptp(each) > 0 else 0.0 for each in said)


def _ways(position: TimeSeries, speed: TimeSeries) -> Array:
    """Return the distances travelled in consecutive intervals of `CHORD_S` [m], shape (1 + latencies, n). Row 0:
    distances between positions. Other rows: integrated speed for each latency of `AGES_S`."""
    t, chord = chords(position, CHORD_S)
    way = cumulative_trapezoid(np.abs(speed.value), speed.t, initial=0)
    return np.stack([chord, *(np.diff(np.interp(t - age, speed.t, way)) for age in AGES_S)])


def _quantities_of_fit(result: VehicleFit, rough: RoughSteering, m: LogMap, drive: _Drive) -> dict[str, Quantity]:
    """Return the calibrated quantities with their 95 % intervals, by map key, computed from the fit `result`."""
    value, index = result.values, {name: k for k, name in enumerate(result.names)}
    assert m.steer is not None
    s, o, k = value["steer_scale"], value["steer_offset"], rough.scale
    # a curvature is treated as its angle
    unit, per = ANGLES.get(m.steer.unit, 1.0), 1.0 / (m.steer.wheelbase_m or 1.0)
    # true angle = s k (reading - rough centre) - o
    slopes = {"steer_offset": per / (s * k), "steer_scale": -per * o / (s * s * k)}
    found: dict[str, tuple[float, dict[str, float]]] = {
        "steer.offset": (per * (rough.centre + o / (s * k)), slopes),
        "steer.scale": (abs(s * k) / unit, {"steer_scale": abs(k) / unit}),
    }
    if "steer_right" in index:
        right, one = value["steer_right"], abs(k) / unit
        found["steer.scale_right"] = (s * right * one, {"steer_scale": right * one, "steer_right": s * one})
    elif m.steer.scale_right is not None:
        found["steer.scale_right"] = found["steer.scale"]
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
    known = {key: _quantity(key, middle, slopes, result, index, drive) for key, (middle, slopes) in found.items()}
    left = known.get("position.left_m")
    if left and m.position and "of" not in m.speed.model_fields_set and not left.excludes(m.position.left_m):
        # with the speed of the antenna, the length of its track is the integral of the speed at any place
        known["position.left_m"] = left._replace(identified=False)
    offset = known.get("heading.offset")
    if offset and m.heading and not offset.excludes(m.heading.offset):
        half = ANGLES[m.heading.unit] * offset.half
        known["heading.offset"] = offset._replace(identified=half < SURE_HEADING_RAD)
    return known


def _wander(data: VehicleData, antennas: DualAntenna) -> float:
    """Return the half width of the interval for the mean drift of a dual-antenna heading [rad], or 0 without a heading.

    The mean drift cannot be distinguished from a mounting angle. Over T time constants, the variance of the mean of a
    first-order process is 2 / T (1 - (1 - e^-T) / T) times the variance of the process.
    """
    if "heading" not in data.channels:
        return 0.0
    T = data.windows * WINDOW_S / antennas.wander_time_s
    return 1.96 * sqrt(2 / T * (1 - (1 - exp(-T)) / T)) * antennas.wander_sigma_m / antennas.baseline_m


def _quantity(
    key: str,
    middle: float,
    slopes: dict[str, float],
    result: VehicleFit,
    index: dict[str, int],
    drive: _Drive,
) -> Quantity:
    """Return the calibrated quantity of a map key with its 95 % interval, from its fitted value `middle`. `slopes`
    contains the derivatives of this value with respect to fitted parameters, by parameter name."""
    if not slopes.keys() <= index.keys():  # the fit omits latencies that the log cannot identify
        return Quantity(middle, middle - 2 * DELAY_S, middle + 2 * DELAY_S, False)
    gradient = np.zeros(len(index))
    for name, slope in slopes.items():
        gradient[index[name]] = slope
    half, name = half_width(result.covariance, gradient, result.freedom), key.partition(".")[2]
    half = hypot(half, slopes.get("heading_offset", 0.0) * drive.wander)
    if name != "offset" and drive.steady:
        half *= ONE_SPEED
    for lag in drive.lags(key):
        middle, half = middle - lag.mean, hypot(half, lag.half)
    if name in ("scale", "scale_right"):
        middle, half = middle / (1 - SCRUB * drive.scrub), hypot(half, SCRUB_HALF * middle * drive.scrub)
    told = half < SURE[name] and (drive.bends or name in ("offset", "scale", "scale_right"))
    return Quantity(middle, middle - half, middle + half, told)


def changed_map(m: LogMap, values: Mapping[str, float | str]) -> LogMap:
    """Return a copy of a column map with new `values` for keys of the form `table.key`."""
    tables: dict[str, dict[str, float | str]] = {}
    for key, value in values.items():
        table, _, name = key.partition(".")
        tables.setdefault(table, {})[name] = value
    return m.model_copy(update={name: getattr(m, name).model_copy(update=each) for name, each in tables.items()})

"""Identification of a vehicle from recordings: a fit to the first part of the logs, and an evaluation on the rest."""

from collections.abc import Iterator, Mapping, Sequence
from math import degrees, inf
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Source
from agrobot_mj.extensions.logs.checks import check_columns
from agrobot_mj.extensions.logs.identify.fit import Prior, VehicleFit, fit
from agrobot_mj.extensions.logs.identify.model import Chassis2, understeer_gradient
from agrobot_mj.extensions.logs.identify.predictions import Channels, predictions
from agrobot_mj.extensions.logs.identify.windows import VehicleData, enough, prepare
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.pieces import read_pieces, split_at
from agrobot_mj.extensions.logs.quantities import Found, Quantity, half_width
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import Bicycle
from agrobot_mj.scenario.schema import Scenario

CHOICES = {
    "front": "front_compliance",
    "rear": "rear_compliance",
    "relaxation": "front_relaxation_m rear_relaxation_m",
    "offset": "steer_offset",
    "scale": "steer_scale",
    "delay": "steer_delay_s",
    "lag": "steer_lag_s",
    "backlash": "backlash",
}
"""Names of the fitted parameters for each choice of the option `--fit`."""
DEFAULT = ("front", "rear", "relaxation", "offset", "delay", "backlash")
"""Default of `--fit`, with delay but without lag, because slow steering does not separate lag and delay."""
LEAST_WINDOWS = 6  # Minimum number of windows for a fit: half a minute of driving at speed
LEAST_STEER_DEG = 0.5  # Minimum RMS steering angle for a fit [deg]
LEAST_EXPLAINED = 0.5
"""Minimum fraction of the yaw-rate variance that a fit must explain in the evaluation [-]. Assumed value."""
SEPARABLE = 0.5
"""Maximum half width of the interval of an identified stiffness, divided by the stiffness [-]. Assumed value."""
PLAUSIBLE = 1.0, 60.0
"""Plausible range of cornering stiffness divided by axle load [1/rad]. Assumed values, wider than the usual ranges of
2-10 on soil and 5-25 on roads."""
MORE_INERTIA, MORE_IN_FRONT = 0.1, 0.02
"""Typical relative error of the yaw inertia, and absolute error of the front load fraction [-]. Assumed values."""
AGE = Prior(0.0, 0.1)  # Prior of the latencies of speed, heading and position, relative to the column map [s]
AGES = ("speed_delay_s", "heading_delay_s", "position_delay_s")
RATE_S = 1.0  # Interval in which a heading difference gives a mean yaw rate [s]


class NothingExplainedError(ScenarioError):
    """Exception for a fit that explains too little variance, or gives an implausible stiffness."""


class IdentifiedVehicle(NamedTuple):
    """Result of the identification of a vehicle from logs."""

    found: dict[str, Quantity]  # Identified quantities by key. The end of a key is the unit.
    windows: int
    explained: float
    """Fraction of the yaw-rate variance that the fit explains in the last part of the log, which is used for the
    evaluation [-]. If only positions are measured, the fraction applies to the position."""
    residual_deg_s: float
    """RMS yaw-rate residual of the fit in the last part of the log, which is used for the evaluation [deg/s], or RMS
    position residual [m] if only positions are measured."""
    kinematic_deg_s: float  # RMS residual of a model without slip in the test part of the log [deg/s or m]
    moved: dict[str, tuple[float, float]]
    """Factors by which front and rear stiffness change with a typical error of an assumed quantity [-], by description
    of the error. Contains the quantities that the scenario does not set."""
    geometry: str  # Geometry of the steering model: `small angles` or `tangent`
    notes: tuple[str, ...]  # Notes about the parts of the logs that are used
    kept: tuple[FieldRecording, ...]  # Segments of the logs that are used


def identify_vehicle(
    source: Source | Sequence[Source],
    log_map: LogMap | None,
    scenario: Scenario,
    names: Sequence[str] = DEFAULT,
    share: float = 0.6,
    start_s: float = 0.0,
    end_s: float = inf,
) -> IdentifiedVehicle:
    """Fit parameters `names` (keys of `CHOICES`) to the first fraction `share` of a log, and evaluate the fit on the
    rest.

    The scenario gives mass, yaw inertia, wheelbase and load fraction. The model for a `bicycle` plant assumes
    small angles. Raises `FieldLogError` for an unsuitable log, `NothingExplainedError` if the fit explains too
    little variance or is implausible.
    """
    chosen = fitted_parameters(names)
    cut = read_pieces(source, log_map, scenario.tractor.antenna_height_m, start_s, end_s)
    name = cut.kept[0].name
    if cut.kept[0].steer is None:
        raise FieldLogError(f"{name}: the map has no [steer]; add it with the column of the wheel angle")
    check_columns(cut.kept)
    chassis = chassis_of(scenario)
    first, second = split_at(cut.kept, share)
    data, rest = _prepare_segments(first, chassis), prepare(second, chassis)
    names = (*chosen, *_ages(data))
    result = fit(data, names, dict.fromkeys(AGES, AGE))
    explained, left, slipless = evaluate_fit(result, rest if rest.windows else data)
    channel = judged_channel(data)
    if not explained > LEAST_EXPLAINED:
        raise NothingExplainedError(
            f"{name}: the fit explains {100 * max(explained, 0.0):.0f} % of the {channel.replace('_', ' ')} "
            f"in the test part of the log, less than {100 * LEAST_EXPLAINED:.0f} %, so the fit gives no result. Check "
            "the sign and unit of the steering, the speed column, and the wheelbase (--set tractor.wheelbase_m=...)"
        )
    found = vehicle_quantities(result, chassis)
    check_stiffness(name, found, chassis)
    moved = dict[str, tuple[float, float]]()
    for change, other in _other_chassis(scenario, chassis) if told_apart(found) else ():
        again = fit(data._replace(chassis=other), names, dict.fromkeys(AGES, AGE)).values
        moved[change] = _ratio(result.values, again, "front"), _ratio(result.values, again, "rear")
    geometry = "small angles" if chassis.small_angles else "tangent"
    return IdentifiedVehicle(found, data.windows, explained, left, slipless, moved, geometry, cut.notes, cut.kept)


def told_apart(found: Found) -> bool:
    """Return whether the stiffnesses of both axles are identified."""
    return all(found[f"{axle}_cornering_stiffness_n_rad"].identified for axle in ("front", "rear"))


def chassis_of(scenario: Scenario) -> Chassis2:
    """Return mass, yaw inertia and axle positions of a scenario, and whether its plant assumes small angles."""
    t, small = scenario.tractor, isinstance(scenario.plant, Bicycle)
    return Chassis2(t.mass_kg, t.yaw_inertia_kg_m2, t.cg_to_front_axle, t.cg_to_rear_axle, small)


def _other_chassis(scenario: Scenario, chassis: Chassis2) -> Iterator[tuple[str, Chassis2]]:
    """Return mass, yaw inertia and axle positions of a scenario's tractor, and whether its plant assumes small
    angles."""
    given, shift = scenario.tractor.model_fields_set, MORE_IN_FRONT * (chassis.l_f + chassis.l_r)
    if "yaw_inertia_kg_m2" not in given:
        inertia = (1 + MORE_INERTIA) * chassis.inertia
        yield f"{100 * MORE_INERTIA:g} % more yaw inertia", chassis._replace(inertia=inertia)
    if "front_load_fraction" not in given:
        moved = chassis._replace(l_f=chassis.l_f - shift, l_r=chassis.l_r + shift)
        yield f"{100 * MORE_IN_FRONT:g} % more of the weight in front", moved


def _ratio(before: Mapping[str, float], after: Mapping[str, float], axle: str) -> float:
    """Return the stiffness of an axle in the fit `after`, divided by its stiffness in the fit `before` [-]."""
    return before[f"{axle}_compliance"] / max(after[f"{axle}_compliance"], 1e-9)


def _ages(data: VehicleData) -> list[str]:
    """Return the names of the fitted latencies, which are relative to the latency of the first measured channel."""
    later = [f"{name}_delay_s" for name in list(data.channels)[1:]]
    return [*later, "speed_delay_s"] if "position" in data.channels else later


def is_plausible(stiffness_per_load: float) -> bool:
    """Return whether a cornering stiffness divided by the wheel load [1/rad] is plausible for tyres."""
    return PLAUSIBLE[0] <= stiffness_per_load <= PLAUSIBLE[1]


def check_stiffness(name: str, found: dict[str, Quantity], chassis: Chassis2) -> None:
    """Raise `NothingExplainedError` if the identified stiffness of an axle is implausible."""
    weight = chassis.mass * GRAVITY / (chassis.l_f + chassis.l_r)
    for axle, load in (("front", weight * chassis.l_r), ("rear", weight * chassis.l_f)):
        C = found[f"{axle}_cornering_stiffness_n_rad"]
        if C.identified and not is_plausible(C.value / load):
            raise NothingExplainedError(
                f"{name}: the fitted cornering stiffness of the {axle} axle is {C.value:.3g} N/rad, "
                f"{C.value / load:.2g} times the axle load. Real tyres have {PLAUSIBLE[0]:g} to {PLAUSIBLE[1]:g} times "
                "the load, so the fit gives no result. Check that [steer] of the map is the wheel angle, and check "
                "the mass (--set tractor.mass_kg=...)"
            )


def fitted_parameters(names: Sequence[str]) -> list[str]:
    """Return the names of the model parameters for the option `--fit`. Raises `ScenarioError` for unknown names, or if
    `front` or `rear` is missing."""
    for name in names:
        if name not in CHOICES:
            known = ", ".join(CHOICES)
            raise ScenarioError(f"--fit {name}: unknown parameter{suggestion(name, list(CHOICES))} (known: {known})")
    if not {"front", "rear"} <= set(names):
        raise ScenarioError("--fit: add front and rear; the other parameters need both stiffnesses")
    return [parameter for name in names for parameter in CHOICES[name].split()]


def _prepare_segments(recordings: Sequence[FieldRecording], chassis: Chassis2) -> VehicleData:
    """Prepare segments for the fit. Raises `TooLittleError` for too few time windows, and `FieldLogError` for too
    little steering."""
    data = enough(recordings, chassis, LEAST_WINDOWS)
    if (moved := degrees(float(np.std(np.concatenate([piece.steer for piece in data.pieces]))))) < LEAST_STEER_DEG:
        raise FieldLogError(
            f"{recordings[0].name}: the steering hardly moves ({moved:.2g} deg rms); use a log with bends"
        )
    return data


def judged_channel(data: VehicleData) -> str:
    """Return the channel that evaluates a fit: `position` if only positions are measured, otherwise `yaw_rate`."""
    return "position" if set(data.channels) == {"position"} else "yaw_rate"


def evaluate_fit(result: VehicleFit, data: VehicleData) -> tuple[float, float, float]:
    """Evaluate a fit on `data`. Return the explained fraction of variance [-], and the RMS residuals of the fit and of
    a model without slip [deg/s or m]."""
    slipless = {"front_compliance": 0.0, "rear_compliance": 0.0}
    measured = _rates({name: each.value for name, each in data.channels.items()}, data)
    off, bare = (_rates(predictions(p, data), data) - measured for p in (result.values, slipless))
    if judged_channel(data) == "position":
        centred, scale = measured - measured.mean(axis=1, keepdims=True), 1.0
    else:
        centred, scale = measured - measured.mean(axis=(0, 1)), 180 / np.pi
    off, bare = (each - each.mean(axis=(0, 1)) for each in (off, bare))
    explained = 1.0 - float((off**2).sum() / max(float((centred**2).sum()), 1e-30))
    return explained, scale * float(np.sqrt((off**2).mean())), scale * float(np.sqrt((bare**2).mean()))


def _rates(values: Channels, data: VehicleData) -> Array:
    """Return yaw rates from a gyro or, if there is no gyro, from differences of the heading over `RATE_S`. Without gyro
    and heading, return the positions."""
    if "heading" in values and "yaw_rate" not in values:
        steps = max(1, round(RATE_S / data.channels["heading"].spacing))
        t, angle = data.channels["heading"].t, values["heading"]
        rates: Array = (angle[:, steps:] - angle[:, :-steps]) / (t[:, steps:] - t[:, :-steps])
        return rates
    return values["yaw_rate"] if "yaw_rate" in values else values["position"]


def vehicle_quantities(result: VehicleFit, chassis: Chassis2) -> dict[str, Quantity]:
    """Return the fitted vehicle quantities in the units of their keys, with 95 % Student t intervals."""
    value, index = result.values, {name: k for k, name in enumerate(result.names)}
    one = np.eye(len(index))
    halves = {name: half_width(result.covariance, one[k], result.freedom) for name, k in index.items()}
    found: dict[str, Quantity] = {}
    for axle in ("front", "rear"):
        c, half = value[f"{axle}_compliance"], halves[f"{axle}_compliance"]
        low, high = 1.0 / (c + half), 1.0 / (c - half) if c > half else inf
        found[f"{axle}_cornering_stiffness_n_rad"] = Quantity(
            1.0 / c if c > 1e-9 else inf, low, high, half < SEPARABLE * c
        )
    l_f, l_r, m, L = chassis.l_f, chassis.l_r, chassis.mass, chassis.l_f + chassis.l_r
    gradient = np.zeros(len(index))
    gradient[index["front_compliance"]], gradient[index["rear_compliance"]] = m * l_r / L, -m * l_f / L
    K = understeer_gradient(chassis, value["front_compliance"], value["rear_compliance"])
    half = half_width(result.covariance, gradient, result.freedom)
    found["understeer_gradient_rad_s2_m"] = Quantity(K, K - half, K + half, abs(K) > half)
    keys = {
        "front_relaxation_m": ("front_relaxation_length_m", 1.0, 0.0),
        "rear_relaxation_m": ("rear_relaxation_length_m", 1.0, 0.0),
        "steer_offset": ("steer_offset_deg", 180 / np.pi, -inf),
        "steer_scale": ("steer_scale", 1.0, 0.0),
        "steer_delay_s": ("steer_delay_s", 1.0, -inf),
        "steer_lag_s": ("steer_lag_s", 1.0, 0.0),
        "backlash": ("backlash_deg", 180 / np.pi, 0.0),
    }
    for name, (key, scale, least) in keys.items():
        if name in index:
            x, half = value[name] * scale, halves[name] * scale
            found[key] = Quantity(x, max(x - half, least), x + half, least < x - half or least == -inf)
    return found

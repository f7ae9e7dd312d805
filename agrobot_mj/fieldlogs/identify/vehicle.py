"""What `agrobot-mj identify --vehicle` does: fit one part of a recording, judge on the rest, say it in a table."""

from collections.abc import Sequence
from math import degrees, inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.fieldlogs.columns import FieldLogError, Source
from agrobot_mj.fieldlogs.identify.fit import VehicleData, VehicleFit, fit, predictions, prepare
from agrobot_mj.fieldlogs.identify.model import Chassis2, understeer_gradient
from agrobot_mj.fieldlogs.maps import LogMap
from agrobot_mj.fieldlogs.recording import read_recording
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants import Bicycle
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.ownership import check_output, reserve
from agrobot_mj.simulation.storage import write_json

CHOICES = {
    "front": "front_compliance",
    "rear": "rear_compliance",
    "relaxation": "front_relaxation_m rear_relaxation_m",
    "offset": "steer_offset",
    "delay": "steer_delay_s",
    "lag": "steer_lag_s",
    "backlash": "backlash",
}
"""What `--fit` may name, and the parameters of the fit."""
DEFAULT = ("front", "rear", "relaxation", "offset", "delay", "backlash")
"""What is fitted unless others are named: lag and delay look the same to slow steering."""
LEAST_WINDOWS = 6
"""Windows that a fit needs: half a minute at speed."""
LEAST_STEER_DEG = 0.5
"""Rms of the steering below which there is nothing to fit [deg]."""
LEAST_EXPLAINED = 0.5
"""Share of the yaw rate's variance on the rest of the log that a result must explain [-]. Estimate: half."""
SEPARABLE = 0.5
"""Half width of an interval over the value, up to which a stiffness counts as identified [-]. Estimate."""
PLAUSIBLE = 1.0, 60.0
"""Cornering stiffness of an axle over its load, least and most [1/rad]. Estimate: 2-10 on soil, 5-25 on roads."""
LEVEL = 0.95


class NothingExplainedError(ScenarioError):
    """The fit explains nothing: no result."""


class FoundQuantity(NamedTuple):
    """A quantity with its interval, in the unit of its key; None where there is none."""

    value: float | None
    low: float | None
    high: float | None
    identified: bool


class IdentifiedVehicle(NamedTuple):
    """A vehicle as identified from a recording."""

    found: dict[str, FoundQuantity]
    """Quantities by their keys, with the unit at the end."""
    windows: int
    """Windows of the fit."""
    explained: float
    """Share of the variance of the yaw rate on the rest of the recording that the fit explains [-]."""
    residual_deg_s: float
    """Rms of what is left there [deg/s]."""
    kinematic_deg_s: float
    """Residual of wheels that do not slip, straight from the recorded angle [deg/s]."""
    geometry: str
    """`small angles` or `tangent`."""


def identify_vehicle(
    source: Source,
    log_map: LogMap | None,
    scenario: Scenario,
    names: Sequence[str] = DEFAULT,
    share: float = 0.6,
    start_s: float = 0.0,
    end_s: float = inf,
) -> IdentifiedVehicle:
    """Fit `names` of `CHOICES` on the first `share` of a log, and judge on the rest.

    Mass, yaw inertia, wheelbase and load share are the scenario's; its plant says whether angles are small (`bicycle`).
    Raises `FieldLogError` for a log that cannot tell, `NothingExplainedError` for a fit that explains nothing.
    """
    chosen = _chosen(names)
    recording = read_recording(source, log_map, scenario.tractor.antenna_height_m).between(start_s, end_s)
    if recording.steer is None:
        raise FieldLogError(f"{recording.name}: its map has no [steer]; a vehicle is identified from the wheel angle")
    t, small = scenario.tractor, isinstance(scenario.plant, Bicycle)
    chassis = Chassis2(t.mass_kg, t.yaw_inertia_kg_m2, t.cg_to_front_axle, t.cg_to_rear_axle, small)
    middle = recording.start + share * (recording.end - recording.start)
    data = _checked(prepare(recording.between(recording.start, middle), chassis))
    rest = prepare(recording.between(middle, recording.end), chassis)
    result = fit(data, chosen)
    channel = "yaw_rate" if "yaw_rate" in data.channels else "position"
    explained, left, slipless = _judged(result, rest if rest.channels else data, channel)
    if not explained > LEAST_EXPLAINED:
        raise NothingExplainedError(
            f"{recording.name}: the fit explains {100 * max(explained, 0.0):.0f} % of the {channel.replace('_', ' ')} "
            f"on the rest of the log, less than {100 * LEAST_EXPLAINED:.0f} %: no result. Check sign and unit of the "
            "steering, the column of the speed, and the wheelbase (--set tractor.wheelbase_m=...)"
        )
    found = _found(result, chassis)
    check_stiffness(recording.name, found, chassis)
    geometry = "small angles" if chassis.small_angles else "tangent"
    return IdentifiedVehicle(found, result.freedom + 1, explained, left, slipless, geometry)


def check_stiffness(name: str, found: dict[str, FoundQuantity], chassis: Chassis2) -> None:
    """Raise `NothingExplainedError` where an axle is identified to be stiffer or softer than tyres are."""
    weight = chassis.mass * GRAVITY / (chassis.l_f + chassis.l_r)
    for axle, load in (("front", weight * chassis.l_r), ("rear", weight * chassis.l_f)):
        C = found[f"{axle}_cornering_stiffness_n_rad"]
        if C.identified and C.value is not None and not PLAUSIBLE[0] <= C.value / load <= PLAUSIBLE[1]:
            raise NothingExplainedError(
                f"{name}: the {axle} axle would have {C.value:.3g} N/rad, {C.value / load:.2g} times its load where "
                f"tyres have {PLAUSIBLE[0]:g} to {PLAUSIBLE[1]:g}: no result. Check that [steer] of the map is the "
                "wheel angle, and the mass (--set tractor.mass_kg=...)"
            )


def identify_vehicle_command(
    source: Source, log_map: LogMap | None, scenario: Scenario, folder: Path | None, **options: Any
) -> str:
    """As `identify_vehicle`; writes `vehicle.json` into `folder`, if given, and returns a table."""
    if folder is not None:
        check_output(folder, ("vehicle.json",))
    found = identify_vehicle(source, log_map, scenario, **options)
    if folder is not None:
        reserve(folder, ("vehicle.json",))
        content = found._asdict() | {"found": {name: each._asdict() for name, each in found.found.items()}}
        write_json(folder / "vehicle.json", content)
    return table(found, scenario)


def _chosen(names: Sequence[str]) -> list[str]:
    for name in names:
        if name not in CHOICES:
            raise ScenarioError(f"--fit {name}: unknown{suggestion(name, list(CHOICES))} (known: {', '.join(CHOICES)})")
    if not {"front", "rear"} <= set(names):
        raise ScenarioError("--fit: name front and rear, too: the model has no other stiffness")
    return [parameter for name in names for parameter in CHOICES[name].split()]


def _checked(data: VehicleData) -> VehicleData:
    """Raise `FieldLogError` unless there is enough to fit."""
    name = data.recording.name
    windows = len(next(iter(data.channels.values())).t) if data.channels else 0
    if windows < LEAST_WINDOWS:
        raise FieldLogError(
            f"{name}: the part for the fit has {windows} whole windows of 5 s at speed with all of its columns, needs "
            f"{LEAST_WINDOWS}; take a longer log, or leave a column with gaps out of the map"
        )
    if (moved := degrees(float(np.std(data.steer)))) < LEAST_STEER_DEG:
        raise FieldLogError(f"{name}: hardly steers ({moved:.2g} deg rms); take a log with bends")
    return data


def _judged(result: VehicleFit, data: VehicleData, channel: str) -> tuple[float, float, float]:
    """Share of the variance explained, and rms left, of the fit and of wheels without slip [deg/s, or m]."""
    measured = data.channels[channel].value
    centred = measured - measured.mean(axis=(0, 1))
    scale = 180 / np.pi if channel == "yaw_rate" else 1.0
    if channel == "position":
        centred = measured - measured.mean(axis=1, keepdims=True)
    off = predictions(result.values, data)[channel] - measured
    off -= off.mean(axis=(0, 1))
    slipless = {"front_compliance": 0.0, "rear_compliance": 0.0}
    bare = predictions(slipless, data)[channel] - measured
    bare -= bare.mean(axis=(0, 1))
    explained = 1.0 - float((off**2).sum() / max(float((centred**2).sum()), 1e-30))
    return explained, scale * float(np.sqrt((off**2).mean())), scale * float(np.sqrt((bare**2).mean()))


def _found(result: VehicleFit, chassis: Chassis2) -> dict[str, FoundQuantity]:
    """Quantities in the units of their keys, with intervals by Student's t."""
    t = float(stdtrit(max(result.freedom, 1), 0.5 + LEVEL / 2))
    value, index = result.values, {name: k for k, name in enumerate(result.names)}
    error = np.sqrt(np.diag(result.covariance))
    found: dict[str, FoundQuantity] = {}
    for axle in ("front", "rear"):
        c, half = value[f"{axle}_compliance"], t * float(error[index[f"{axle}_compliance"]])
        low, high = 1.0 / (c + half), 1.0 / (c - half) if c > half else None
        found[f"{axle}_cornering_stiffness_n_rad"] = FoundQuantity(
            1.0 / c if c > 1e-9 else None, low, high, half < SEPARABLE * c
        )
    l_f, l_r, m, L = chassis.l_f, chassis.l_r, chassis.mass, chassis.l_f + chassis.l_r
    gradient = np.zeros(len(error))
    gradient[index["front_compliance"]], gradient[index["rear_compliance"]] = m * l_r / L, -m * l_f / L
    K = understeer_gradient(chassis, value["front_compliance"], value["rear_compliance"])
    half = t * float(np.sqrt(gradient @ result.covariance @ gradient))
    found["understeer_gradient_rad_s2_m"] = FoundQuantity(K, K - half, K + half, abs(K) > half)
    keys = {
        "front_relaxation_m": ("front_relaxation_length_m", 1.0, 0.0),
        "rear_relaxation_m": ("rear_relaxation_length_m", 1.0, 0.0),
        "steer_offset": ("steer_offset_deg", 180 / np.pi, -inf),
        "steer_delay_s": ("steer_delay_s", 1.0, -inf),
        "steer_lag_s": ("steer_lag_s", 1.0, 0.0),
        "backlash": ("backlash_deg", 180 / np.pi, 0.0),
    }
    for name, (key, scale, least) in keys.items():
        if name in index:
            x, half = value[name] * scale, t * float(error[index[name]]) * scale
            found[key] = FoundQuantity(x, max(x - half, least), x + half, least < x - half or least == -inf)
    return found


def table(found: IdentifiedVehicle, scenario: Scenario) -> str:
    """Values with their 95 % intervals as plain text and valid Markdown, and what they are worth."""
    rows = [(key, *map(_text, each[:3]), "yes" if each.identified else "no") for key, each in found.found.items()]
    lines = [markdown_table(("quantity", "value", "from", "to", "identified"), rows, 1, aligned=True)]
    if not all(found.found[f"{axle}_cornering_stiffness_n_rad"].identified for axle in ("front", "rear")):
        lines.append("The axles cannot be told apart in this log: take the understeer gradient, which both share.")
    if (b := found.found.get("backlash_deg")) and not b.identified:
        lines.append("No backlash is seen beyond the noise of the recorded angle.")
    lines.append(
        f"On the rest of the log the fit explains {100 * found.explained:.2f} % and leaves "
        f"{found.residual_deg_s:.3f} rms; wheels without slip leave {found.kinematic_deg_s:.3f} (deg/s, or m)."
    )
    t = scenario.tractor
    lines.append(
        f"Taken as known: {t.mass_kg:g} kg, {t.yaw_inertia_kg_m2:g} kg m2, wheelbase {t.wheelbase_m:g} m, "
        f"{100 * t.front_load_fraction:g} % in front; {found.geometry}; {found.windows} windows of 5 s."
    )
    return "\n".join(lines)


def _text(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"

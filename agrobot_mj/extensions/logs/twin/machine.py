"""Machine file of a digital twin. Some keys are identified from a log, with intervals; the other keys come from a
similar machine."""

from collections.abc import Mapping
from math import degrees, isfinite
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.logs.calibrate import Calibration
from agrobot_mj.extensions.logs.identify.vehicle import is_plausible, told_apart
from agrobot_mj.extensions.logs.identify.windows import channels_of
from agrobot_mj.extensions.logs.quantities import Found
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.scenario.machines import TABLES, machine_file, machine_tables
from agrobot_mj.scenario.overrides import explicit_values, override
from agrobot_mj.scenario.schema import Scenario

MARGIN_DEG = 1.0  # Margin between maximum recorded angle and steering limit [deg]
MOST_STEER_DEG = 60.0  # Maximum plausible steering limit [deg]
BACKLASH = "steering.linkage.backlash_deg"
MOST_CENTRE_DEG, MOST_SCALE = 20.0, (0.2, 5.0)
"""Limits of a steering sensor in a scenario: maximum centre error [deg], and range of the scale factor [-]."""
CARCASS = (0.05, 2.0)
"""Permitted range of the lateral stiffness of a tyre carcass divided by the vertical stiffness [-]."""


class TwinKey(NamedTuple):
    """Value of a machine key that is identified from a log."""

    value: float | bool
    note: str  # Comment for the machine file: interval or source of the value


def twin_keys(c: Calibration, found: Found, scenario: Scenario) -> dict[str, TwinKey]:
    """Return the scenario values identified from a log, by dotted scenario key."""
    keys = {**_tyres(found, scenario), **_sensors(c)}
    if (play := found.get("backlash_deg")) and play.identified:
        keys[BACKLASH] = TwinKey(round(play.value, 2), f"{play.low:.2g} to {play.high:.2g}")
    largest = degrees(c.largest_angle)
    if largest > scenario.tractor.steer_limit_deg:
        limit = min(round(largest + MARGIN_DEG), MOST_STEER_DEG)
        keys["tractor.steer_limit_deg"] = TwinKey(limit, f"the log reaches {largest:.1f}")
    return keys


def _tyres(found: Found, scenario: Scenario) -> dict[str, TwinKey]:
    """Return the identified tyre stiffnesses and relaxation lengths as keys of the plant and tyre model in a scenario.
    The result is empty unless both axles are identified."""
    t, keys = scenario.tractor, dict[str, TwinKey]()
    tyre = getattr(getattr(scenario.plant, "tyre", None), "kind", "bicycle")
    if not told_apart(found):
        return {}
    for axle, load in (("front", t.front_axle_load), ("rear", t.rear_axle_load)):
        C = found[f"{axle}_cornering_stiffness_n_rad"]
        if not isfinite(C.high) or not is_plausible(C.value / load):
            return {}
        key, share = {
            "bicycle": (f"plant.{axle}_cornering_stiffness_n_rad", 1.0),
            "linear": (f"plant.tyre.{axle}_cornering_stiffness_n_rad", 0.5),
            "magic_formula": (f"plant.tyre.{axle}.lateral.stiffness_per_load", 1.0 / load),
        }.get(tyre, ("", 0.0))
        if key:
            keys[key] = TwinKey(float(f"{share * C.value:.4g}"), f"{share * C.low:.3g} to {share * C.high:.3g}")
    if tyre in ("linear", "magic_formula"):
        keys |= _relaxation(found, t, tyre)
    return keys


def _relaxation(found: Found, t: TractorParameters, tyre: str) -> dict[str, TwinKey]:
    """Return the key of the mean relaxation length for the tyre model `tyre`, or {} if no length is identified."""
    shares, radii = [], []
    for axle, wheel in zip(("front", "rear"), t.wheels, strict=True):
        length, C = found[f"{axle}_relaxation_length_m"], found[f"{axle}_cornering_stiffness_n_rad"]
        if length.identified and length.value and isfinite(C.value):
            radii.append(length.value / wheel.radius)
            shares.append(C.value / 2 / (wheel.stiffness * length.value))
    if not radii:
        return {}
    note = f"relaxation lengths of {np.mean(radii):.2f} radii"
    if tyre == "linear":
        return {"plant.tyre.relaxation_radii": TwinKey(round(float(np.mean(radii)), 3), note)}
    share = float(np.clip(np.mean(shares), *CARCASS))
    return {"plant.tyre.carcass_lateral": TwinKey(round(share, 3), note)}


def _sensors(c: Calibration) -> dict[str, TwinKey]:
    """Return the identified keys of the steering sensor, of the receiver and its antenna, and of the second antenna."""
    scale = degrees(abs(c.rough.scale)) * c.fit.values["steer_scale"]
    keys = {
        "sensors.steering_pot.noise_sigma_deg": TwinKey(
            round(degrees(c.data.steer_noise), 3), "noise of one measurement in the log"
        )
    }
    if steps := _step(c):
        keys["sensors.steering_pot.resolution_deg"] = TwinKey(round(steps * scale, 4), "one measurement")
    keys |= _settings(c)
    if (position := c.pieces.kept[0].position) is not None:
        ticks = min(max(1, round(float(np.median(np.diff(position.t))) / TICK_S)), round(1 / TICK_S))
        keys["sensors.gnss.rate_hz"] = TwinKey(1 / (ticks * TICK_S), "rate of the log, in whole ticks")
    age = c.found.get("position.delay_s")
    if age and age.identified and (ticks := round(age.value / TICK_S)) >= 0:
        keys["sensors.gnss.latency_s"] = TwinKey(round(ticks * TICK_S, 2), f"{' to '.join(age.ends)}, in whole ticks")
    for place in ("ahead_m", "left_m"):
        if (found := c.found.get(f"position.{place}")) and found.identified:
            keys[f"tractor.antenna_{place}"] = TwinKey(found.rounded, " to ".join(found.ends))
            if c.log_map.position and place in c.log_map.position.model_fields_set:
                given = getattr(c.log_map.position, place)
                keys[f"sensors.gnss.configured_{place}"] = TwinKey(given, f"position.{place} of the given map")
    if "heading" in channels_of(c.pieces.kept[0]):
        keys["sensors.gnss.dual_antenna.enabled"] = TwinKey(True, "the log has a heading")
        if (off := c.heading_error) is not None:
            keys["sensors.gnss.dual_antenna.mounting_deg"] = TwinKey(round(degrees(off), 2), _mounting(c))
    return keys


def _settings(c: Calibration) -> dict[str, TwinKey]:
    """Return the keys of centre error and scale errors of the steering sensor, relative to the original column map."""
    keys, told = dict[str, TwinKey](), c.steer.model_fields_set
    left, right = c.found["steer.scale"], c.found.get("steer.scale_right", c.found["steer.scale"])
    given = c.steer.scale if "scale" in told else left.value
    if "offset" in told and abs(off := -degrees(c.centre_error) * given / left.value) <= MOST_CENTRE_DEG:
        note = f"steer.offset of the map {' to '.join(c.found['steer.offset'].ends)}, not {c.steer.offset:g}"
        keys["sensors.steering_pot.centre_deg"] = TwinKey(round(off, 2), note)
    for side, used, found in (("left", given, left), ("right", c.steer.scale_right or given, right)):
        share = used / found.value
        if found.identified and found.excludes(used) and MOST_SCALE[0] <= share <= MOST_SCALE[1]:
            note = f"{used:.4g} of the map divided by {' to '.join(found.ends)}"
            keys[f"sensors.steering_pot.scale_{side}"] = TwinKey(float(f"{share:.4g}"), note)
    return keys


def twin_faults(c: Calibration) -> list[dict[str, Any]]:
    """Return the identified latencies as faults of a scenario, except the latency of the receiver."""
    age = {key.removesuffix(".delay_s"): each.value for key, each in c.found.items() if each.identified}
    found = {"steering_pot": age.get("steer", 0.0)}
    if c.log_map.heading is not None and "position" in age and "heading" in age:
        found["heading"] = age["heading"] - max(age["position"], 0.0)
    if c.log_map.speed.of == "wheel":
        found["wheel_speed"] = age.get("speed", 0.0)
    ticks = {line: round(value / TICK_S) for line, value in found.items()}
    return [
        {"kind": f"{line}_delay", "start_s": 0.0, "delay_s": round(n * TICK_S, 2)} for line, n in ticks.items() if n > 0
    ]


def _step(c: Calibration) -> float:
    """Return the resolution of the sensor values [unit of the sensor], or 0 for continuous values."""
    steer = c.pieces.kept[0].steer
    steps = np.diff(np.unique(np.round(steer.value / c.rough.scale, 6))) if steer else np.empty(0)
    return float(steps.min()) if len(steps) and steps.min() > 0.5 * np.median(steps) else 0.0


def _mounting(c: Calibration) -> str:
    ends = c.found.get("heading.offset")
    return f"heading.offset of the map {' to '.join(ends.ends)}" if ends else ""


def machine_data(scenario: Scenario, keys: Mapping[str, TwinKey], title: str) -> dict[str, Any]:
    """Return the tables of a machine file: the machine of the scenario, updated with the identified `keys`."""
    file = machine_file(scenario.machine)
    tables = machine_tables(file[0]) if file else {}
    own = explicit_values(scenario)
    own.pop("guidance", None)  # belongs to the simulation, not to the machine
    data: dict[str, Any] = {"title": title}
    for name in TABLES:
        if table := merge_tables(tables.get(name, {}), own.get(name, {})):
            data[name] = table
    for key, each in keys.items():
        override(data, key, each.value, scenario)
    return data


def merge_tables(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a merge of two nested tables. Values of `above` take precedence over values of `below`."""
    found = dict(below)
    for key, value in above.items():
        old = found.get(key)
        found[key] = merge_tables(old, value) if isinstance(value, Mapping) and isinstance(old, Mapping) else value
    return found


def not_told(scenario: Scenario, keys: Mapping[str, TwinKey]) -> list[tuple[str, object, str]]:
    """Return the tractor keys that a log does not identify, with their values and the sources of these values."""
    file = machine_file(scenario.machine)
    of_machine = (machine_tables(file[0]) if file else {}).get("tractor", {})
    given = explicit_values(scenario).get("tractor", {})
    found = []
    for name, value in scenario.tractor:
        if f"tractor.{name}" not in keys and value is not None:
            source = "given" if name in given else f"machine {scenario.machine}" if name in of_machine else "default"
            found.append((f"tractor.{name}", value, source))
    return found

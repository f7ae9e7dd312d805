"""Measurements of a tyre on the rig, as one table.

Columns: `test`, `tyre` (its type), `axle`, `speed_m_s`, `load_n`, `slip_angle_rad`, `slip_ratio`, `distance_m` (`step`
only), `fx_n`, `fy_n`, `mz_n_m`, `grounded` (see `wheel.Reading`). Rows by `test`:

    lateral        sweep of the slip angle of a rolling wheel, at every load (1 m/s) and at every speed (static load)
    longitudinal   sweep of the slip ratio, at every load (1 m/s) and at every speed (static load)
    combined       sweep of the slip ratio at several slip angles, and of the slip angle to large values
    step           response versus the distance after a step in slip angle, at every speed, for tyres with relaxation
    contact        small slip angles with MuJoCo's contact model at every speed, front axle, for comparison

A tyre is given by its type, or by a scenario file whose tables `[plant.tyre]` and `[tractor]` set the tyre, sizes and
loads.
"""

from collections.abc import Iterable, Iterator
from math import radians
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from agrobot_mj.core.errors import PLUGIN, ScenarioError, suggestion
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.bench.rig.towed import Towed
from agrobot_mj.extensions.bench.rig.wheel import AXLES, FRONT, Rig, Setting, static_load
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants import Mujoco
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.reference import families
from agrobot_mj.scenario.schema import resolve
from agrobot_mj.tyres import Tyre, TyreBase
from agrobot_mj.tyres.base import NativeContact


class Specimen(NamedTuple):
    """Tyre to be tested, with the tractor that sets its size and load."""

    tyre: Tyre
    tractor: TractorParameters


def load_specimen(source: str) -> Specimen:
    """Return the tyre to be tested. `source` is a type of tyre, which selects its default parameters, or a scenario
    file."""
    kinds = list(families()["plant.tyre"])
    if source in kinds:
        scenario = resolve({"plant": {"kind": "mujoco", "tyre": {"kind": source}}}, source)
    elif source.endswith(".toml") or Path(source).is_file():
        scenario = load_scenario(Path(source))
    else:
        hint = f"{suggestion(source, kinds)} (known: {', '.join(kinds)}; or a scenario file); {PLUGIN}"
        raise ScenarioError(f"unknown tyre {source!r}{hint}")
    if not isinstance(scenario.plant, Mujoco):
        raise ScenarioError(f"{Path(source).name}: plant.kind: must be 'mujoco', got {scenario.plant.kind!r}")
    return Specimen(scenario.plant.tyre, scenario.tractor)


SPEEDS_M_S = (0.5, 1.0, 2.0, 4.0)  # Speeds for measuring the effect of speed [m/s]
SPEED_M_S = 1.0  # Speed of all measurements except the speed sweep [m/s]
LOADS = (0.5, 1.0, 1.5, 2.0)  # Loads for measuring the effect of load, as fractions of the static load [-]
ANGLES_DEG = (0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20)
"""Magnitudes of the slip angles of the test `lateral`, finer near zero [deg]."""
RATIOS = (0, 0.001, 0.002, 0.005, 0.01, 0.015, *np.arange(0.02, 0.1, 0.01), *np.arange(0.1, 0.525, 0.025))
"""Magnitudes of the slip ratios of the test `longitudinal`, finer near zero [-]."""
COMBINED_DEG = (0, 1, 2, 4, 8, 16)  # Slip angles at which the slip ratio is swept in the test `combined` [deg]
FAR_DEG, FAR_RATIO = 60.0, 0.9  # Maximum slip angle [deg] and maximum slip ratio [-] of the test `combined`
CREEP_DEG = tuple(np.arange(0, 1.55, 0.05))  # Magnitudes of the slip angles of the test `contact` [deg]
STEP_DEG = 1.0  # Size of the slip-angle step [deg], in the linear range of tyres
STEP_LENGTHS, STEP_ROWS = 4.0, 200
"""Distance recorded after a slip-angle step [relaxation lengths], and number of table rows of the response."""
COLUMNS = ["test", "tyre", "axle", "speed_m_s", "load_n", "slip_angle_rad", "slip_ratio", "distance_m"]
COLUMNS += ["fx_n", "fy_n", "mz_n_m", "grounded"]
"""Names of the columns of the results table."""

Row = tuple[str | float | None, ...]


def bench(tyre: TyreBase, tractor: TractorParameters, wheel: int = FRONT) -> Towed | Rig:
    """Return the test rig of a tyre: `Towed` for the contact model of MuJoCo, otherwise `Rig`."""
    return Towed(tyre.native, tractor, wheel) if tyre.native else Rig(tyre, tractor, wheel)


def sweep(tyre: Tyre, tractor: TractorParameters) -> pa.Table:
    """Run all tests of the front and the rear tyre of a tractor. Return the results as a table."""
    rows: list[Row] = []
    for axle, wheel in AXLES.items():
        tests = _tests(bench(tyre, tractor, wheel), static_load(tractor, wheel))
        rows += [(test, tyre.kind, axle, *numbers) for test, *numbers in tests]
    contact = tyre.native or NativeContact()
    creep = lateral(SPEEDS_M_S, [static_load(tractor, FRONT)], CREEP_DEG)
    rows += [("contact", "contact", "front", *numbers) for numbers in _steady(Towed(contact, tractor), creep)]
    columns = [pa.array(list(column)) for column in zip(*rows, strict=True)]
    return pa.table(columns, names=COLUMNS)


def lateral(
    speeds: Iterable[float], loads: Iterable[float], angles_deg: Iterable[float] = ANGLES_DEG
) -> Iterator[Setting]:
    """Return rig settings with positive and negative slip angles, for all speeds and loads."""
    angles = both_ways(np.radians(list(angles_deg)))
    return (Setting(v, float(a), 0.0, load) for v in speeds for load in loads for a in angles)


def longitudinal(speeds: Iterable[float], loads: Iterable[float]) -> Iterator[Setting]:
    """Return rig settings with positive and negative slip ratios, for all speeds and loads."""
    ratios = both_ways(np.array(RATIOS))
    return (Setting(v, 0.0, float(k), load) for v in speeds for load in loads for k in ratios)


def combined_slip_settings(load: float) -> Iterator[Setting]:
    """Yield rig settings of the test `combined`: swept slip ratios at several slip angles, then free rolling at slip
    angles up to `FAR_DEG`."""
    ratios = FAR_RATIO * np.sin(np.linspace(-1, 1, 61) * np.pi / 2) ** 3
    yield from (Setting(SPEED_M_S, float(a), float(k), load) for a in np.radians(COMBINED_DEG) for k in ratios)
    yield from (Setting(SPEED_M_S, float(a), 0.0, load) for a in np.radians(np.linspace(0, FAR_DEG, 61)))


def both_ways(values: Array) -> Array:
    """Return `values` (n,) and their negatives in ascending order, shape (2 n - 1,). The first value must be zero."""
    return np.concatenate([-values[:0:-1], values])


def _tests(rig: Towed | Rig, static: float) -> Iterator[Row]:
    """Yield result rows of one wheel: test name, rig setting, distance, forces, moment and contact fraction."""
    loads = [share * static for share in LOADS]
    others = [speed for speed in SPEEDS_M_S if speed != SPEED_M_S]
    for test, settings in (("lateral", lateral), ("longitudinal", longitudinal)):
        for case in (settings([SPEED_M_S], loads), settings(others, [static])):
            yield from ((test, *numbers) for numbers in _steady(rig, case))
    yield from (("combined", *numbers) for numbers in _steady(rig, combined_slip_settings(static)))
    for speed in SPEEDS_M_S if rig.relaxation else ():
        yield from (("step", *numbers) for numbers in _step(rig, Setting(speed, radians(STEP_DEG), 0.0, static)))


def _steady(rig: Towed | Rig, settings: Iterable[Setting]) -> Iterator[Row]:
    for s in settings:
        yield (s.speed, s.load, s.slip_angle, s.slip_ratio, None, *_forces(rig.steady(s)))


def _step(rig: Towed | Rig, s: Setting) -> Iterator[Row]:
    readings = rig.history(s, STEP_LENGTHS * rig.relaxation)
    for k in np.unique(np.linspace(0, len(readings) - 1, STEP_ROWS).astype(int)):
        distance = (k + 1) / len(readings) * STEP_LENGTHS * rig.relaxation
        yield (s.speed, s.load, s.slip_angle, s.slip_ratio, distance, *_forces(readings[k]))


def _forces(reading: Iterable[float]) -> tuple[float, float, float, float]:
    fx, fy, mz, _, grounded = (float(value) for value in reading)
    return fx, fy, mz, grounded

"""Hints about valid scenario keys that have no effect, or probably not the intended effect. Hints do not end a run."""

from collections.abc import Iterator
from math import ceil

from agrobot_mj.core.contracts import without_exit
from agrobot_mj.core.learned import read_learned
from agrobot_mj.core.signals import ROUNDING_S, TICK_S
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.overrides import explicit_values, flat
from agrobot_mj.scenario.path_hints import path_hints
from agrobot_mj.scenario.schema import Scenario, on_machine

OTHER_LAP = 0.02
"""Maximum relative difference between the lap of a learned map and the path [-]. Assumed value: points 0.25 m apart."""


def hints(scenario: Scenario) -> list[str]:
    """Return one line for each key that has no effect or does not suit the size of the machine or the path."""
    own = (_faults, _late, _overruled, _machine, _learned, path_hints)
    return [line for part in own for line in part(scenario)]


def _faults(scenario: Scenario) -> Iterator[str]:
    end = scenario.ticks * TICK_S
    for k, fault in enumerate(scenario.fault):
        first = max(0, ceil((fault.start_s - ROUNDING_S) / TICK_S)) * TICK_S
        if first >= end - ROUNDING_S:
            yield f"fault[{k}].start_s: {fault.start_s:g} s is not before the end of the run, {end:g} s"
        elif not fault.active(first):
            window = f"{fault.start_s:g} to {fault.last_s:g} s"
            yield f"fault[{k}]: the window {window} contains no tick of {TICK_S:g} s, so the fault has no effect"


def _late(scenario: Scenario) -> Iterator[str]:
    late, most = scenario.sensors.gnss.latency_s, scenario.supervisor.coasting_after_s
    if scenario.supervisor.enabled and late > most:
        why = f"the latency of the fixes is always longer (sensors.gnss.latency_s = {late:g} s), so the tractor coasts"
        yield f"supervisor.coasting_after_s: {most:g} s; {why}"


def _overruled(scenario: Scenario) -> Iterator[str]:
    given = flat(explicit_values(on_machine({"machine": scenario.machine})))
    used = dict(flat(scenario.model_dump(mode="json")))
    other = [key for key, value in given if used.get(key) != value]
    if len(other) > len(given) / 2:
        first = f"{other[0]} = {used.get(other[0])!r}"
        yield f"machine: the scenario overrides {len(other)} of {len(given)} keys of {scenario.machine!r} ({first})"


def _machine(scenario: Scenario) -> list[str]:
    try:
        with without_exit():
            return list(scenario.plant.hints(scenario.vehicle, scenario.path.speed_m_s))
    except ValueError:
        return []  # the machine is invalid; its construction reports the error


def _learned(scenario: Scenario) -> Iterator[str]:
    if (file := getattr(scenario.guidance, "file", None)) is None:
        return
    lap = SampledRoute(scenario.path).lap()
    for places in (rows[:, 0] for rows in read_learned(file).values() if len(rows) > 1):
        learnt = float(places[0] + places[-1])  # map points are at the middle of equal segments of the lap
        if abs(learnt - lap) > OTHER_LAP * lap:
            laps = f"a lap of {learnt:.4g} m, but the lap of this path is {lap:.4g} m"
            yield f"guidance.file: the file was learned on {laps}; check that the path is the same"
            return

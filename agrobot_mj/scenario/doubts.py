"""What a scenario says that is legal, but hardly meant: told before a run, which goes on."""

from collections.abc import Iterator
from math import ceil

from agrobot_mj.core.contracts import without_exit
from agrobot_mj.core.signals import ROUNDING_S, TICK_S
from agrobot_mj.scenario.overrides import explicit_values, flat
from agrobot_mj.scenario.schema import Scenario, on_machine


def doubts(scenario: Scenario) -> list[str]:
    """One line for each key that has no effect, or that does not fit the machine's size, beginning with it."""
    return [*_faults(scenario), *_overruled(scenario), *_machine(scenario)]


def _faults(scenario: Scenario) -> Iterator[str]:
    end = scenario.ticks * TICK_S
    for k, fault in enumerate(scenario.fault):
        first = max(0, ceil((fault.start_s - ROUNDING_S) / TICK_S)) * TICK_S
        if first >= end - ROUNDING_S:
            yield f"fault[{k}].start_s: {fault.start_s:g} s is not before the end of the run, {end:g} s"
        elif not fault.active(first):
            window = f"{fault.start_s:g} to {fault.last_s:g} s"
            yield f"fault[{k}]: its window, {window}, holds no tick of {TICK_S:g} s; it will not act"


def _overruled(scenario: Scenario) -> Iterator[str]:
    """A machine of whose keys the scenario gives most otherwise, as the resolved file of another machine does."""
    given = flat(explicit_values(on_machine({"machine": scenario.machine})))
    used = dict(flat(scenario.model_dump(mode="json")))
    other = [key for key, value in given if used.get(key) != value]
    if len(other) > len(given) / 2:
        first = f"{other[0]} = {used.get(other[0])!r}"
        yield f"machine: the scenario itself gives {len(other)} of {len(given)} keys of {scenario.machine!r} ({first})"


def _machine(scenario: Scenario) -> list[str]:
    try:
        with without_exit():
            return list(scenario.plant.doubts(scenario.vehicle, scenario.path.speed_m_s))
    except ValueError:
        return []  # no such machine can be: whoever builds it says so

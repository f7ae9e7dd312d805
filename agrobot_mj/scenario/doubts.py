"""What a scenario says that is legal, but hardly meant: told before a run, which goes on."""

from math import ceil

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.faults.base import ROUNDING_S
from agrobot_mj.scenario.schema import Scenario


def doubts(scenario: Scenario) -> list[str]:
    """One line for each key that has no effect, beginning with it."""
    end, found = scenario.ticks * TICK_S, []
    for k, fault in enumerate(scenario.fault):
        first = max(0, ceil((fault.start_s - ROUNDING_S) / TICK_S)) * TICK_S
        if first >= end - ROUNDING_S:
            found.append(f"fault[{k}].start_s: {fault.start_s:g} s is not before the end of the run, {end:g} s")
        elif not fault.active(first):
            window = f"{fault.start_s:g} to {fault.last_s:g} s"
            found.append(f"fault[{k}]: its window, {window}, holds no tick of {TICK_S:g} s; it will not act")
    return found

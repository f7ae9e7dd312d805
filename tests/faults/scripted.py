"""Conditions at each tick due to a list of faults."""

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.faults import Script


def scripted(faults, ticks, seed=1):
    """Return the conditions due to a list of faults at each tick from the start."""
    script, found = Script(tuple(faults), seed), []
    state = script.init()
    for k in range(ticks):
        state, conditions = script.update(state, k * TICK_S, TICK_S)
        found.append(conditions)
    return found

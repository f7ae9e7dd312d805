"""Continuation of a run with another scenario, as if this scenario had been simulated from the start."""

from agrobot_mj.core.errors import CommandError
from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.script import Script
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.snapshot import Snapshot
from agrobot_mj.simulation.stepping import Simulation, resume_simulation

FREE = {"name", "title", "duration_s", "expected_outcome", "expected_reason", "fault", "guidance"}
"""Scenario keys that may differ between a saved run and its continuation."""


def continue_run(state: Snapshot, scenario: Scenario) -> Simulation:
    """Return a simulation of `scenario` that continues from a state saved during a run of a similar scenario.

    The duration may differ, and faults may be added or changed without effect on the past. The type of the guidance law
    must be the same, because the law keeps its state. Raises `CommandError` for other differences, and for a duration
    below the current time.
    """
    before, t = state.scenario, fetched(state.loop.seen).t
    changed = [
        key for key in Scenario.model_fields if key not in FREE and getattr(before, key) != getattr(scenario, key)
    ]
    if before.guidance.kind != scenario.guidance.kind:
        changed.append("guidance.kind")
    if changed:
        raise CommandError(f"continued: {', '.join(changed)} must not change during a run; start another run")
    if state.rows.filled > scenario.ticks:
        raise CommandError(f"continued: duration_s: must be at least the current time, {t:g} s")
    stages = {**state.loop.stages, "faults": _fault_states(state, scenario, t + TICK_S / 2)}
    return resume_simulation(Simulation, state._replace(scenario=scenario, loop=state.loop._replace(stages=stages)))


def _fault_states(state: Snapshot, scenario: Scenario, now: float) -> tuple[object, ...]:
    """Return the fault states of the new scenario: saved states for unchanged faults, otherwise initial states."""
    kept, old, new = state.loop.stages["faults"], state.scenario.fault, scenario.fault
    states = list(Script(new, scenario.seed).init())
    for k in range(max(len(old), len(new))):
        ours, theirs = (faults[k] if k < len(faults) else None for faults in (old, new))
        if ours is not None and theirs is not None and _same_past(ours, theirs, now):
            states[k] = kept[k]
        elif any(fault is not None and fault.start_s < now for fault in (ours, theirs)):
            raise CommandError(
                f"continued: fault[{k}]: the change must not affect the time before {now:g} s; set a later start_s"
            )
    return tuple(states)


def _same_past(ours: Scripted, theirs: Scripted, now: float) -> bool:
    """Return whether two faults are equal, or differ only in their end times, which are later than `now` [s]."""
    if type(ours) is not type(theirs) or ours.model_copy(update={"end_s": theirs.end_s}) != theirs:
        return False
    return ours.end_s == theirs.end_s or min(ours.last_s, theirs.last_s) > now

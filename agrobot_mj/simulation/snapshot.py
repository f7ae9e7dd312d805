"""Snapshot of a simulation: its complete state, and the log up to the current time.

A snapshot is independent of its simulation and can be restored any number of times, in any `Simulation` of the same
scenario and, after pickling, in another process. Snapshots of a run share the blocks of the log, so that the cost of
saving does not increase during the run.
"""

from typing import Any, NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.core.errors import CommandError
from agrobot_mj.core.held import Held
from agrobot_mj.core.signals import Command, Measurement, Truth
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import SavedRows
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.outcomes import Standstill


class LoopState(NamedTuple):
    """Saved state of a `Loop`."""

    plant: Any
    stages: dict[str, Any]  # States of the stages, by name in `Stages`
    seen: Held[Truth]  # True state after the last step of the plant
    sensed: tuple[Measurement, Situation] | None
    """Last measurement and guidance inputs, without the sampled path, or None before the first measurement."""
    commanded: tuple[Any, Command] | None
    """Result of the guidance law if an episode has called the law for the next tick, otherwise None."""


class Snapshot(NamedTuple):
    """Saved state of a `Simulation`."""

    scenario: Scenario
    loop: LoopState  # State of plant and stages
    rows: SavedRows
    standstill: Standstill  # Position and duration of the standstill
    ending: tuple[str, str]  # Outcome and reason of the end of the run, or empty strings before the end


def loop_state(loop: Loop) -> LoopState:
    """Return the state of a loop between two ticks. The state is not copied."""
    pending = loop.law.pending
    commanded = None if isinstance(pending, BaseException) else pending
    return LoopState(loop.plant.save(), dict(vars(loop.stages)), loop.seen, _on_route(loop.sensed, None), commanded)


def set_loop_state(loop: Loop, state: LoopState) -> None:
    """Set the state of a loop. The objects in `state` are not copied and must not be used elsewhere."""
    loop.plant.restore(state.plant)
    for name, value in state.stages.items():
        setattr(loop.stages, name, value)
    loop.seen, loop.sensed = state.seen, _on_route(state.sensed, loop.route)
    loop.has_sensed, loop.law.pending = loop.sensed is not None, state.commanded


def _on_route(sensed: tuple[Measurement, Situation] | None, route: Any) -> Any:
    return sensed and (sensed[0], sensed[1]._replace(route=route))


def require_same_scenario(snapshot: Snapshot, scenario: Scenario) -> None:
    """Raise `CommandError` if the snapshot belongs to another scenario."""
    theirs = snapshot.scenario
    if theirs is scenario or theirs == scenario:
        return
    keys = [key for key in Scenario.model_fields if getattr(theirs, key) != getattr(scenario, key)]
    raise CommandError(
        f"restore: the state belongs to a different scenario ({', '.join(keys)} differ); restore it into a "
        "Simulation of the same scenario with the same overrides"
    )

"""A saved simulation: everything that decides how it goes on, and the log up to there.

A snapshot shares nothing with the simulation it was taken from, so that it can be restored any number of times, into
any `Simulation` of the same scenario, also in another process (it can be pickled). The rows of the log are kept in
blocks that snapshots of the same run share: saving in every tick costs the same at the end of a run as at its start.
"""

from typing import Any, NamedTuple

from agrobot_mj.control.base import Situation
from agrobot_mj.core.errors import CommandError
from agrobot_mj.core.signals import Measurement, Truth
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import SavedRows
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.outcomes import Standstill


class LoopState(NamedTuple):
    """A saved `Loop`."""

    plant: Any
    stages: dict[str, Any]
    """States of the stages, by their names in `Stages`."""
    truth: Truth
    """True state after the last step of the plant."""
    sensed: tuple[Measurement, Situation] | None
    """What was sensed last, without the path, which every simulation samples for itself; None before the first time."""


class Snapshot(NamedTuple):
    """A saved `Simulation`."""

    scenario: Scenario
    loop: LoopState
    """Plant and stages."""
    rows: SavedRows
    standstill: Standstill
    """How long the tractor has not moved."""
    ending: tuple[str, str]
    """Outcome and its reason, empty before the end."""


def loop_state(loop: Loop) -> LoopState:
    """What a loop keeps between two ticks; its parts may still be written to."""
    return LoopState(loop.plant.save(), dict(vars(loop.stages)), loop.truth, _on_route(loop.sensed, None))


def set_loop_state(loop: Loop, state: LoopState) -> None:
    """Let a loop go on from a state, which it takes over."""
    loop.plant.restore(state.plant)
    for name, value in state.stages.items():
        setattr(loop.stages, name, value)
    loop.truth, loop.sensed = state.truth, _on_route(state.sensed, loop.route)


def _on_route(sensed: tuple[Measurement, Situation] | None, route: Any) -> Any:
    return sensed and (sensed[0], sensed[1]._replace(route=route))


def require_same_scenario(snapshot: Snapshot, scenario: Scenario) -> None:
    """Raise `CommandError` unless a snapshot belongs to this scenario."""
    theirs = snapshot.scenario
    if theirs is scenario or theirs == scenario:
        return
    keys = [key for key in Scenario.model_fields if getattr(theirs, key) != getattr(scenario, key)]
    raise CommandError(
        f"restore: the state belongs to another scenario than this one ({', '.join(keys)} differ); restore it into a "
        "Simulation of the same scenario with the same overrides"
    )

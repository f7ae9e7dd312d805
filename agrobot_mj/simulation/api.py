"""Function `run` of the Python API, which simulates a scenario and warns of probable mistakes in its keys."""

import warnings
from collections.abc import Callable
from pathlib import Path

from agrobot_mj.core.contracts import check_argument
from agrobot_mj.scenario.hints import hints
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation import run as simulation
from agrobot_mj.simulation.log import Log


class ScenarioWarning(UserWarning):
    """Warning about a scenario key without effect or with a probably unintended effect."""


def run(
    scenario: str | Path | Scenario,
    watchers: tuple[simulation.Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Simulate a scenario, given by name, path or object, to its end. Return the log and write no files.

    Hints about the scenario are issued as `ScenarioWarning`. The same scenario gives bit-identical signals on the same
    machine. `should_stop` is called repeatedly, at least once per 10 s of simulated time; the run ends as `aborted` if
    this function returns True.

    Raises `ScenarioError` for an infeasible tractor and for a guidance law that is an external program. Raises
    TypeError for an argument of a wrong type.
    """
    watched = isinstance(watchers, tuple) and all(hasattr(each, "advance") for each in watchers)
    check_argument("watchers", watchers, watched, "a tuple of watchers (start, advance, finish, fail)")
    check_argument("should_stop", should_stop, callable(should_stop), "a function without arguments")
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    for line in hints(scenario):
        warnings.warn(f"{scenario.name}: {line}", ScenarioWarning, stacklevel=2)
    return simulation.run(scenario, watchers, should_stop)

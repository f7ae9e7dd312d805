"""Whether the tractor of a scenario can be, without running it: what a plan of many runs asks of each combination."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.faults import loadings
from agrobot_mj.plants import Mujoco
from agrobot_mj.plants.mujoco.build import build
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.terrain.grid import plane

LEVEL = plane(0.0, 0.0, 10.0, 10.0)
"""Ground under a tractor that is only looked at."""


def tractor_key(scenario: Scenario) -> object:
    """All that decides whether the tractor can be; scenarios with the same key share the answer."""
    s, plant = scenario, scenario.plant
    if not isinstance(plant, Mujoco):
        return None
    parts = (s.tractor, s.steering.cylinder, s.steering.linkage, s.driveline, s.implement)
    return (plant.tyre, *parts, s.step_s, tuple(loadings(s.fault)))


def check_tractor(scenario: Scenario) -> None:
    """Raise `ScenarioError` for a tractor that cannot be: an impossible chassis, tyres that are not stable."""
    s = scenario
    if isinstance(s.plant, Mujoco):
        with naming(s):
            build(s.plant.tyre, s.vehicle, LEVEL, s.step_s, payloads=loadings(s.fault))


@contextmanager
def naming(scenario: Scenario) -> Iterator[None]:
    """A ValueError within the block becomes a `ScenarioError` that begins with the scenario's name."""
    try:
        yield
    except ValueError as error:
        raise ScenarioError(f"{scenario.name or 'scenario'}: {error}") from None


def check_tractors(scenarios: Iterable[Scenario]) -> None:
    """`check_tractor` of scenarios, once for all that share a tractor."""
    for scenario in {tractor_key(scenario): scenario for scenario in scenarios}.values():
        check_tractor(scenario)

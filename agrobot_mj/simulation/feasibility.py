"""Checks that tractors can be built and are stable. Studies check all tractors before the first run."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.faults import loadings
from agrobot_mj.plants import Mujoco
from agrobot_mj.plants.mujoco.build import build
from agrobot_mj.plants.mujoco.drawing import Ghost
from agrobot_mj.scenario.machines import COMPACT
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.terrain.grid import plane

LEVEL = plane(0.0, 0.0, 10.0, 10.0)  # Level ground for the check of a tractor


def tractor_key(scenario: Scenario) -> object:
    """Return the data on which the check of a tractor depends. Scenarios with equal data need only one check."""
    s, plant = scenario, scenario.plant
    if not isinstance(plant, Mujoco):
        return s.tractor
    parts = (s.tractor, s.steering.cylinder, s.steering.linkage, s.driveline, s.implement)
    return (plant.tyre, *parts, s.step_s, tuple(loadings(s.fault)))


def check_tractor(scenario: Scenario) -> None:
    """Raise `ScenarioError` if the chassis of the tractor is physically impossible or its tyres are unstable."""
    s = scenario
    with naming(s.name if s.machine == COMPACT else f"{s.name}, machine {s.machine}"):
        if isinstance(s.plant, Mujoco):
            build(s.plant.tyre, s.vehicle, LEVEL, s.step_s, payloads=loadings(s.fault))
        else:  # the bicycle plant draws its tractor
            Ghost(s.tractor)


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Convert a ValueError in the context to a `ScenarioError` whose message starts with `name`."""
    try:
        yield
    except ValueError as error:
        raise ScenarioError(f"{name or 'scenario'}: {error}") from None


def check_tractors(scenarios: Iterable[Scenario]) -> None:
    """Run `check_tractor` once for each distinct tractor of the scenarios."""
    for scenario in {tractor_key(scenario): scenario for scenario in scenarios}.values():
        check_tractor(scenario)

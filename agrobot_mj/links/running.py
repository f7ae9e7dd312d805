"""How a run over a link begins and ends, whatever the link: nothing compiled late, one word for the outcome."""

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.stepping import Simulation


class NotBegunError(ScenarioError):
    """The program outside has not come, so that there was no run."""


def warm_up(scenario: Scenario) -> None:
    """One tick of a simulation of its own: what is compiled on first use must not make the first turns late."""
    sim = Simulation(scenario)
    sim.reset()
    sim.step()


def linked_outcome(own: str, ended: str | None) -> str:
    """The link's word `ended`, if any, where the run itself ended as planned or was cut short by the link."""
    return ended if ended is not None and own in ("completed", "aborted") else own

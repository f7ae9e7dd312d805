"""High-fidelity MuJoCo simulation of an autonomous tractor's guidance stack.

>>> from agrobot_mj import load_scenario, run
>>> log = run(load_scenario("figure_eight", {"seed": 3}))
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from agrobot_mj.core.version import __version__

__all__ = ["Simulation", "__version__", "load_scenario", "register", "run"]

if TYPE_CHECKING:
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.scenario.plugins import register
    from agrobot_mj.simulation.api import run
    from agrobot_mj.simulation.stepping import Simulation

_HOMES = {
    "Simulation": "agrobot_mj.simulation.stepping",
    "load_scenario": "agrobot_mj.scenario.loading",
    "register": "agrobot_mj.scenario.plugins",
    "run": "agrobot_mj.simulation.api",
}


def __getattr__(name: str) -> Any:
    """Import a name of the API when it is first used. This keeps the import of individual modules fast."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

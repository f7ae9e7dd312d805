"""High-fidelity MuJoCo simulation of an autonomous tractor's guidance stack.

>>> from agrobot_mj import load_scenario, run
>>> log = run(load_scenario("figure_eight", {"seed": 3}))
"""

from typing import TYPE_CHECKING, Any

from agrobot_mj.core.version import __version__

__all__ = ["__version__", "load_scenario", "run"]

if TYPE_CHECKING:
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.run import run


def __getattr__(name: str) -> Any:
    """The API on first use, so that a part of the package can be imported without the whole."""
    if name == "load_scenario":
        from agrobot_mj.scenario.loading import load_scenario

        return load_scenario
    if name == "run":
        from agrobot_mj.simulation.run import run

        return run
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

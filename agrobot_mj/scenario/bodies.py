"""A machine's own body in plain data: what `tractor.mjcf` gives joins the keys of `[tractor]`, and must not differ."""

from math import isclose
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.plants.mujoco.own_body import measures

SPRINGS = tuple(f"{end}_tyre_{what}" for end in ("front", "rear") for what in ("stiffness_n_m", "damping_n_s_m"))
"""Keys by which a body stands higher or lower on its tyres."""
EXACT = 1e-6
"""Relative difference from which a given value is not the body's [-]."""


def embody(data: dict[str, Any], source: str) -> set[str]:
    """Add to plain data the keys of `[tractor]` that its body gives; their names.

    Raises `ScenarioError` with every fault of the body, or every key that says other than it does.
    """
    tractor = data.get("tractor")
    if not isinstance(tractor, dict) or not isinstance(name := tractor.get("mjcf"), str) or not name:
        return set()
    springs = {key: float(k) for key in SPRINGS if isinstance(k := tractor.get(key), int | float) and k > 0}
    try:
        found = measures(name, springs)
    except ValueError as error:
        raise ScenarioError("\n".join(f"{source}: tractor.mjcf: {line}" for line in str(error).split("\n"))) from None
    wrong = [
        f"{source}: tractor.{key}: the body of {Path(name).name} has {value:g}, got {tractor[key]}; leave it out"
        for key, value in found.items()
        if key in tractor and not _same(tractor[key], value)
    ]
    if wrong:
        raise ScenarioError("\n".join(wrong))
    added = set(found) - set(tractor)
    tractor.update(found)
    return added


def _same(given: Any, value: float) -> bool:
    return isinstance(given, int | float) and isclose(given, value, rel_tol=EXACT)

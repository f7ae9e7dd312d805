"""Numbers that are not finite in one message of one tick: they must be named, or count as missing."""

import random
import traceback
from math import inf, isfinite, nan
from typing import Any

from agrobot_mj import load_scenario, run
from agrobot_mj.simulation.loop import Loop

STAGES = {"truth": "plant", "measured": "sensors", "estimate": "estimator", "command": "guidance"}
"""Stages, and the word by which a message names them."""
UNUSED = (["wheel_speed"], ["nis"], ["steer_bias"], ["fix_age"], ["position_sigma"], ["nis_mean"])
"""Fields that may be NaN, or that only diagnostics use."""


def injected(chance: random.Random) -> str:
    """One number of one message."""
    stage, value, at = chance.choice(list(STAGES)), chance.choice([nan, inf, -inf]), chance.randrange(1, 10)
    plant, sense, decide, ticks = chance.choice(["bicycle", "mujoco"]), Loop.sense, Loop.decide, [0]
    changed: list[str] = []

    def spoil(message: Any) -> Any:
        names = [name for name in message._fields if isinstance(getattr(message, name), float)]
        changed.append(chance.choice([name for name in names if isfinite(getattr(message, name)) and name != "t"]))
        return message._replace(**{changed[0]: value})

    def wrapped(loop: Loop) -> Any:
        ticks[0] += 1
        spec = {"measured": type(loop.scenario.sensors), "estimate": type(loop.scenario.estimator)}.get(stage)
        if ticks[0] != at:
            return sense(loop)
        if stage == "truth":
            loop.truth = spoil(loop.truth)
        if spec is None:
            return sense(loop)
        method = "measure" if stage == "measured" else "update"
        whole = getattr(spec, method)
        setattr(spec, method, lambda *a: (lambda found: (found[0], spoil(found[1])))(whole(*a)))
        try:
            return sense(loop)
        finally:
            setattr(spec, method, whole)

    def decided(loop: Loop, *messages: Any) -> Any:
        if stage != "command" or ticks[0] != at:
            return decide(loop, *messages)
        law = type(loop.guidance)
        whole = law.update
        law.update = lambda *a: (lambda found: (found[0], spoil(found[1])))(whole(*a))  # type: ignore[method-assign]
        try:
            return decide(loop, *messages)
        finally:
            law.update = whole  # type: ignore[method-assign]

    Loop.sense, Loop.decide = wrapped, decided  # type: ignore[method-assign]
    try:
        log = run(load_scenario("figure_eight", {"duration_s": 1.0, "plant.kind": plant}))
    except Exception:
        return f"{stage}.{changed}: {traceback.format_exc(limit=-3)}"
    finally:
        Loop.sense, Loop.decide = sense, decide  # type: ignore[method-assign]
    named = log.outcome == "diverged" and STAGES[stage][:5] in log.metrics["stop_reason"]
    healed = log.outcome == "completed" and (stage == "measured" or changed[:1] in UNUSED)
    return "" if named or healed else f"{stage}.{changed} = {value}: {log.outcome}, {log.metrics.get('stop_reason')}"

"""Invalid scenarios, sweeps and terrain files, and non-finite numbers in a tick."""

import random
import traceback
from functools import cache
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hostile import VALUES, bent, odd_array, odd_lines, terrain_files
from judge import LONGEST_TEXT, call

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.kernels import fetched, held
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.plants import BicyclePlant, MujocoPlant
from agrobot_mj.scenario.loading import scenario_files
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.sensors import Suite
from agrobot_mj.simulation import stepping
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep

SHORT = ("--no-rrd", "--quiet", "--set", "duration_s=0.5", "--set", "plant.kind=bicycle", "--out", "out")


@cache
def keys() -> dict[str, Any]:
    """Return the values of the default scenario by dotted key."""
    return dict(flat(load_scenario("figure_eight").model_dump(mode="json")))


@cache
def numbers() -> list[tuple[str, float]]:
    """Return the scenario keys with nonzero numbers, and their values, except keys that increase the duration of a
    run."""
    short = ("settle", "physics_dt", "duration", "turns", "half_size", "seed", "rules_")
    return [(k, v) for k, v in keys().items() if isinstance(v, float) and v and not any(part in k for part in short)]


def sets(*texts: str) -> list[str]:
    """Return the `--set` arguments for `KEY=VALUE` texts."""
    return [word for text in texts for word in ("--set", text)]


def overrides(chance: random.Random) -> str:
    """Run a scenario with odd values for one to three keys."""
    texts = [f"{chance.choice(list(keys()))}={chance.choice(VALUES)}" for _ in range(chance.randint(1, 3))]
    return call(["run", "circle", *SHORT, *sets(*texts)])


def toml(chance: random.Random) -> str:
    """Run a scenario of the library with changed bytes and lines."""
    Path("mine.toml").write_bytes(odd_lines(chance, chance.choice(list(scenario_files().values()))))
    return call(["run", "mine.toml", *SHORT])


def sweeps(chance: random.Random) -> str:
    """Read a sweep with hostile axes, draws and counts. The sweep must be rejected with a message, or be usable."""
    if chance.random() < 0.3:
        Path("mine.toml").write_bytes(odd_lines(chance, chance.choice(list(sweep_files().values()))))
    else:
        Path("mine.toml").write_text(_sweep(chance), encoding="utf-8", errors="surrogatepass")
    try:
        plan = SweepPlan(read_sweep(Path("mine.toml")))
        plan.check_size(200)
        plan.check()
    except ScenarioError as error:
        return "" if 0 < len(str(error)) < 10 * LONGEST_TEXT else f"a message of {len(str(error))} characters"
    scenario = plan.sweep.base.changed(plan.run(chance.randrange(plan.total)).overrides)
    settling = {"plant.settle_limit_s": 3.0, "plant.settle_s": 0.1} if scenario.plant.kind == "mujoco" else {}
    if scenario.guidance.kind != "nmpc":
        run(scenario.changed({"duration_s": 0.2, **settling}))  # the plan should have rejected this scenario
    return ""


def _sweep(chance: random.Random) -> str:
    (key, value), (other, base) = chance.sample(numbers(), 2)
    span, odd = chance.choice([0.5, 1.5, 3.0, 100.0, -1.0, 0.0]), chance.choice(VALUES)
    axes = [f"[{value}, {value * span}]", f"[{odd}, {value}]", odd, "{ from = 0, to = nan, count = 3 }"]
    axes += [f"{{ from = {value}, to = {value * span}, count = {count} }}" for count in (2, 5, 0, 10**9)]
    draws = [f"{{ uniform = [{base}, {base * span}] }}", f"{{ normal = [{base}, {odd}] }}", "{ choice = [] }", odd]
    seeds = chance.choice(["", "", "", *(f"seeds = {n}\n" for n in ("2", "0", "[1, 1]", "10**3", "999999999", odd))])
    drawn = f'[draws]\n"{other}" = {chance.choice(draws)}\n' if chance.random() < 0.5 else ""
    start = f'base = "{chance.choice(["circle", "side_slope_5", "nope"])}"\n{seeds}[set]\n'
    plant = f'"plant.kind" = "{chance.choice(["mujoco", "bicycle"])}"\n'
    return f'{start}{plant}[axes]\n"{key}" = {chance.choice(axes)}\n{drawn}'


def extremes(chance: random.Random) -> str:
    """Run a scenario on the MuJoCo plant with extreme numbers. The numbers must be rejected with their limits, or the
    run must have a valid outcome."""
    factors = [1e-9, 1e-3, 0.1, 0.5, 2.0, 10.0, 1e3, 1e9, -1.0]
    chosen = chance.sample(numbers(), chance.randint(1, 3))
    texts = [f"{key}={value * chance.choice(factors)!r}" for key, value in chosen]
    kind = chance.choice(["linear", "magic_formula", "soil", "contact", "ruts"])
    path = chance.choice(["circle", "side_slope_5", "figure_eight"])
    short = sets("duration_s=0.5", "plant.settle_s=0.2", "plant.settle_limit_s=2", f"plant.tyre.kind={kind}", *texts)
    return call(["run", path, "--no-rrd", "--quiet", "--out", "out", *short])


def files(chance: random.Random) -> str:
    """Run a scenario with a damaged file of heights or waypoints."""
    name, content = chance.choice(list(terrain_files().items()))
    file = Path(f"bent{Path(name).suffix}")
    odd = file.suffix == ".npy" and chance.random() < 0.5
    file.write_bytes(odd_array(chance) if odd else bent(chance, content))
    if file.suffix == ".csv":
        words = ["path.kind=waypoints", f"path.file={file.name}"]
    else:
        words = ["terrain.kind=heightmap", f"terrain.file={file.name}", "plant.kind=mujoco", "duration_s=0.2"]
        words += ["plant.settle_s=0.1", "plant.settle_limit_s=1"]
    return call(["run", "straight_line", *SHORT, *sets(*words)])


UNUSED = ("wheel_speed", "nis", "steer_bias", "fix_age", "position_sigma", "nis_mean")
"""Message fields that may be NaN, or that only diagnostics use."""


def injected(chance: random.Random) -> str:
    """Replace a number in a message by NaN or infinity. The run must report the number or treat it as missing."""
    kind, value, at = chance.choice(["bicycle", "mujoco"]), chance.choice([nan, inf, -inf]), chance.randrange(1, 10)
    s, calls = load_scenario("figure_eight", {"duration_s": 1.0, "plant.kind": kind}), [0]
    stage, owner, method = chance.choice(
        [
            ("plant", BicyclePlant if kind == "bicycle" else MujocoPlant, "advance_held"),
            ("sensors", Suite, "measure"),
            ("estimator", type(s.estimator), "update"),
            ("guidance", type(s.guidance.using(s.controller)), "update"),
        ]
    )
    whole, changed = getattr(owner, method), ""

    def spoilt(*arguments: Any) -> Any:
        nonlocal changed
        calls[0] += 1
        found = whole(*arguments)
        if calls[0] != at:
            return found
        message = fetched(found) if stage == "plant" else found[1]
        given = {name: getattr(message, name) for name in message._fields if name != "t"}
        changed = chance.choice([name for name, v in given.items() if isinstance(v, float) and isfinite(v)])
        message = message._replace(**{changed: value})
        return held(message) if stage == "plant" else (found[0], message)

    try:
        with patch.object(owner, method, spoilt), patch.object(stepping, "SHORTEST", inf):
            log = run(s)
    except Exception:
        return f"{stage}.{changed}: {traceback.format_exc(limit=-3)}"
    reason = log.metrics.get("stop_reason")
    named = log.outcome == "diverged" and stage[:5] in reason
    healed = log.outcome == "completed" and (stage == "sensors" or changed in UNUSED)
    return "" if changed and (named or healed) else f"{stage}.{changed} = {value}: {log.outcome}, {reason}"

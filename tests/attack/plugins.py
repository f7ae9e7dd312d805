"""Plugins that raise errors, return nonsense, or register twice."""

import random
from pathlib import Path
from typing import NamedTuple

from judge import call
from texts import SHORT, sets

PLUGIN = '''
from math import nan
from typing import Literal
import agrobot_mj
import numpy as np
from agrobot_mj.{module} import {base}
from agrobot_mj.core.signals import Command, Conditions, Estimate, Reference
from agrobot_mj.terrain.grid import plane
{above}

class Mine({base}):
    """Of a family of mine."""
    {kind}
    {more}
    {key}

    def init(self, *arguments):
        {init}

    def {method}:
        {answer}
{below}
'''
ODD = {
    "above": (
        *("1 / 0", "raise SystemExit(3)", "import nothing_of_this_name", "def (", "\x00", "raise KeyboardInterrupt"),
    ),
    "kind": tuple(f'kind: Literal["{kind}"] = "{kind}"' for kind in ("lqr", "kinematic", "", "é", "a b")),
    "key": (
        *("gain: float = 1.0", "gain: float = 'x'", "gain: object = object()", "seed_: int"),
        "kp: float = float('nan')",
    ),
    "init": ("raise ValueError('no')", "return (1, 2)", "return lambda: 0"),
    "below": (
        *("agrobot_mj.register(Mine)", "agrobot_mj.register(Mine); agrobot_mj.register(Mine)"),
        *("agrobot_mj.register(int)", "agrobot_mj.register(3)", "class Other(Mine): pass"),
    ),
}
"""Erroneous texts for each part of a plugin file, by name of the part."""
RIGHT = {"above": "", "kind": 'kind: Literal["mine"] = "mine"', "key": "", "init": "return None", "below": ""}
ANSWERS = (
    *("return None", "return 3", "return 'x'", "return (None,)", "return None, None", "return None, nan", "pass"),
    *("return None, (1.0, 2.0)", "return 1 / 0", "raise ValueError('no')", "raise RuntimeError('broken')"),
    *("raise SystemExit(3)", "raise SystemExit(0)", "raise KeyboardInterrupt", "raise MemoryError"),
)
"""Erroneous bodies for a method of any plugin."""


class Family(NamedTuple):
    """Family of kinds that a plugin may extend."""

    module: str
    base: str
    method: str  # name of the method, with its arguments
    key: str  # override that selects the kind in a scenario
    answers: tuple[str, ...] = ()
    more: str = ""  # further lines of the class


COMMANDS = (
    *("Command(nan, 1.0)", "Command(0.1, float('inf'))", "Command('left', 1.0)", "Command(None, None)", "0.1"),
    *("Command(1e300, -1e300)", "Command(np.zeros(3), 1.0)", "Command(np.float32(0.1), np.float64(1.0))"),
    *("Command(0.1 + 1j, 1.0)", "Command(0.1, 1.0, nan)", "None", "Command(0.1, 1.0)", "Command(0.1, 1.0)"),
)
RECURSES = "return self.update(state, situation, dt)"
NUMBERS = "duration_s = property(lambda self: {n}); max_curvature = property(lambda self: {n}); sharpest = None"
FLAT = "flat = plane(0.0, 0.0, 10.0, 10.0); return flat._replace("
GRIDS = (f"{FLAT}heights=np.full((3, 3), nan))", f"{FLAT}heights=np.zeros(3))", f"{FLAT}spacing=0.0)")
REFERENCES = tuple(f"return Reference(*[{n}] * len(Reference._fields))" for n in ("nan", "1e300"))
ESTIMATE = ("return None, Estimate(*[nan] * len(Estimate._fields))",)
CONDITIONS = tuple(f"return None, conditions._replace({text})" for text in ("grip=nan", "gnss_latency_s=-nan"))
FAULT = 'fault=[{ kind = "mine", start_s = 0.1 }]'
LAW = tuple(f"return state, {command}" for command in COMMANDS)
LAWS = Family("control", "GuidanceLaw", "update(self, state, situation, dt)", "guidance.kind=mine", (*LAW, RECURSES))
FAMILIES = (
    *(LAWS, LAWS, LAWS, LAWS),
    Family(
        "estimation.base", "StateEstimator", "update(self, state, measurement, dt)", "estimator.kind=mine", ESTIMATE
    ),
    Family("faults.base", "Scripted", "apply(self, state, conditions, t, dt)", FAULT, CONDITIONS),
    Family("sensors.base", "Sensor", "measure(self, state, truth, conditions, dt)", "seed=1"),
    Family("terrain.base", "Landscape", "relief(self)", "terrain.kind=mine", GRIDS),
    Family("paths.base", "ReferencePath", "at(self, t)", "path.kind=mine", REFERENCES, NUMBERS.format(n="1.0")),
    Family("paths.base", "ReferencePath", "at(self, t)", "path.kind=mine", REFERENCES, NUMBERS.format(n="None")),
    Family(
        *("tyres.base", "TyreBase", "coefficients(self, tractor)", "plant.tyre.kind=mine", ()),
        more="structure = lambda s: None",
    ),
)
RIGHT_LAW = PLUGIN.format(**LAWS._asdict() | RIGHT, answer="return state, Command(0.1, 1.0)")
"""Valid guidance law, which must be accepted."""


def plugins(chance: random.Random) -> str:
    """Run a plugin with one or two errors. A traceback may contain only exceptions and lines of the plugin."""
    family = chance.choice(FAMILIES)
    odd = {name: chance.choice(ODD[name]) for name in chance.sample(list(ODD), chance.choice([0, 0, 1, 2]))}
    parts = {**RIGHT, **({"kind": ""} if family.base == "Sensor" else {}), **odd}
    answer = chance.choice(family.answers if family.answers and chance.random() < 0.6 else ANSWERS)
    text = PLUGIN.format(**family._asdict() | parts, answer=answer)
    if chance.random() < 0.05:
        text = chance.choice(["", "x = 1", "\xff" * 10, text[: len(text) // 2]])
    Path("mine.py").write_text(text, encoding="utf-8", errors="surrogateescape")
    plant = ["plant.kind=mujoco", "plant.settle_s=0.1", "plant.settle_limit_s=1"]
    more = plant if family.module in ("terrain.base", "tyres.base") else []
    files = ["--plugin", "mine.py"] * (2 if chance.random() < 0.1 else 1)
    expected = (0, 1) if text == RIGHT_LAW and len(files) == 2 else (0, 1, 2, 130)
    found = call(["run", "straight_line", *files, *SHORT, *sets(*more, family.key)], expected)
    return "" if "__pycache__" in found or 'mine.py"' in found else found

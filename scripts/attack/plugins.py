"""Plugins: files of a user's own that raise, return nonsense, or register twice."""

import random
from pathlib import Path

from judge import call
from texts import SHORT, sets

LAW = '''
from typing import Literal
from agrobot_mj.control import GuidanceLaw, Situation
from agrobot_mj.core.signals import Command
{above}

class Mine(GuidanceLaw):
    """A law."""
    kind: Literal["{kind}"] = "{kind}"
    {key}

    def init(self):
        {init}

    def update(self, state, situation: Situation, dt: float):
        """Command."""
        {update}
{below}
'''
KINDS = ("mine", "mine", "mine", "mine", "lqr", "kinematic", "", "é", "a b")
ABOVE = (
    "",
    "",
    "",
    "",
    "1 / 0",
    "raise SystemExit(3)",
    "import nothing_of_this_name",
    "def (",
    "\x00",
    "raise KeyboardInterrupt",
)
KEYS = (
    "",
    "",
    "",
    "gain: float = 1.0",
    "gain: float = 'x'",
    "gain: object = object()",
    "seed_: int",
    "kp: float = float('nan')",
)
INITS = ("return None", "return None", "return None", "raise ValueError('no')", "return (1, 2)", "return lambda: 0")
GOOD = "return state, Command(0.1, 1.0)"
UPDATES = (
    GOOD,
    "raise RuntimeError('broken')",
    "raise ValueError('broken')",
    "return 1 / 0",
    "return None",
    "return state",
    "return state, None",
    "return state, 0.1",
    "return state, Command(float('nan'), 1.0)",
    "return state, Command(0.1, float('inf'))",
    "return state, Command('left', 1.0)",
    "return state, Command(None, None)",
    "return state, Command(1e300, -1e300)",
    "import numpy as np; return state, Command(np.zeros(3), 1.0)",
    "import numpy as np; return state, Command(np.float32(0.1), np.float64(1.0))",
    "return state, Command(0.1 + 1j, 1.0)",
    "return state, Command(0.1, 1.0, float('nan'))",
    "return state, (0.1, 1.0)",
    "raise SystemExit(0)",
    "raise KeyboardInterrupt",
    "raise MemoryError",
    "return self.update(state, situation, dt)",
)
BELOW = (
    "",
    "",
    "",
    "import agrobot_mj; agrobot_mj.register(Mine)",
    "import agrobot_mj; agrobot_mj.register(Mine); agrobot_mj.register(Mine)",
)
BELOW = (
    *BELOW,
    "import agrobot_mj; agrobot_mj.register(int)",
    "import agrobot_mj; agrobot_mj.register(3)",
    "class Other(Mine): pass",
)


OTHER = '''
from math import nan
from typing import Literal
import numpy as np
from agrobot_mj.{module}.base import {base}
from agrobot_mj.core.signals import Conditions, Estimate, Reference
from agrobot_mj.terrain.grid import plane

class Mine({base}):
    """Of a family of mine."""
    {kind}
    {more}

    def {method}:
        {answer}
'''
KIND = 'kind: Literal["mine"] = "mine"'
ANSWERS = ("return None", "return 3", "return 'x'", "return (None,)", "return None, None", "return None, nan", "pass")
ANSWERS = (*ANSWERS, "return None, (1.0, 2.0)", "return 1 / 0", "raise ValueError('no')", "raise SystemExit(3)")
FLAT = "flat = plane(0.0, 0.0, 10.0, 10.0); return flat._replace("
NUMBERS = "duration_s = property(lambda self: {n}); max_curvature = property(lambda self: {n}); sharpest = None"
FAMILIES: tuple[tuple[str, str, str, str, str, tuple[str, ...]], ...] = (
    (
        "estimation",
        "StateEstimator",
        "init = lambda self, *a: None",
        "update(self, state, measurement, dt)",
        "estimator.kind=mine",
        ("return None, Estimate(*[nan] * len(Estimate._fields))",),
    ),
    (
        "faults",
        "Scripted",
        "",
        "apply(self, state, conditions, t, dt)",
        'fault=[{ kind = "mine", start_s = 0.1 }]',
        ("return None, conditions._replace(grip=nan)", "return None, conditions._replace(gnss_latency_s=-nan)"),
    ),
    (
        "sensors",
        "Sensor",
        "init = lambda self, seed: None",
        "measure(self, state, truth, conditions, dt)",
        "seed=1",
        (),
    ),
    (
        "terrain",
        "Landscape",
        "",
        "relief(self)",
        "terrain.kind=mine",
        (f"{FLAT}heights=np.full((3, 3), nan))", f"{FLAT}heights=np.zeros(3))", f"{FLAT}spacing=0.0)"),
    ),
    (
        "paths",
        "ReferencePath",
        NUMBERS.format(n="1.0"),
        "at(self, t)",
        "path.kind=mine",
        ("return Reference(*[nan] * len(Reference._fields))", "return Reference(*[1e300] * len(Reference._fields))"),
    ),
    ("paths", "ReferencePath", NUMBERS.format(n="None"), "at(self, t)", "path.kind=mine", ()),
    ("tyres", "TyreBase", "structure = lambda self: None", "coefficients(self, tractor)", "plant.tyre.kind=mine", ()),
)
"""Families: module, base, what else the class gives, its method, the key that chooses it, and answers of its own."""


def others(chance: random.Random) -> str:
    """A kind of another family, whose one method answers with nonsense."""
    module, base, more, method, key, own = chance.choice(FAMILIES)
    kind = "" if base == "Sensor" else KIND
    answer = chance.choice([*ANSWERS, *own, *own])
    text = OTHER.format(module=module, base=base, kind=kind, more=more, method=method, answer=answer)
    Path("mine.py").write_text(text, encoding="utf-8")
    plant = "mujoco" if module in ("terrain", "tyres") else "bicycle"
    more_keys = ["plant.settle_s=0.1", "plant.settle_limit_s=1"] if plant == "mujoco" else []
    words = ["run", "straight_line", "--plugin", "mine.py", *SHORT, *sets(f"plant.kind={plant}", *more_keys, key)]
    return _not_its_own(call(words, (0, 1, 2, 130)))


def _not_its_own(found: str) -> str:
    """What is wrong, unless it is an error that the plugin's own lines raise."""
    return "" if "__pycache__" in found or "mine.py" in found else found


def plugins(chance: random.Random) -> str:
    """A guidance law that is wrong in some way; what the law raises may be shown, with its own lines."""
    if chance.random() < 0.4:
        return others(chance)
    parts = {"above": ABOVE, "kind": KINDS, "key": KEYS, "init": INITS, "update": UPDATES, "below": BELOW}
    odd = chance.sample(list(parts), chance.choice([1, 1, 2]))
    text = LAW.format(
        **{name: chance.choice(choices) if name in odd else choices[0] for name, choices in parts.items()}
    )
    if chance.random() < 0.1:
        text = chance.choice(["", "x = 1", "\xff" * 10, text[: len(text) // 2]])
    Path("mine.py").write_text(text, encoding="utf-8", errors="surrogateescape")
    twice = ["--plugin", "mine.py"] if chance.random() < 0.1 else []
    words = ["run", "circle", "--plugin", "mine.py", *twice, *SHORT, *sets("guidance.kind=mine")]
    return _not_its_own(call(words, (0, 1, 2, 130)))

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


def plugins(chance: random.Random) -> str:
    """A guidance law that is wrong in some way; what the law raises may be shown, with its own lines."""
    parts = {"above": ABOVE, "kind": KINDS, "key": KEYS, "init": INITS, "update": UPDATES, "below": BELOW}
    odd = chance.sample(list(parts), chance.choice([1, 1, 2]))
    text = LAW.format(
        **{name: chance.choice(choices) if name in odd else choices[0] for name, choices in parts.items()}
    )
    if chance.random() < 0.1:
        text = chance.choice(["", "x = 1", "\xff" * 10, text[: len(text) // 2]])
    Path("mine.py").write_text(text, encoding="utf-8", errors="surrogateescape")
    twice = ["--plugin", "mine.py"] if chance.random() < 0.1 else []
    found = call(["run", "circle", "--plugin", "mine.py", *twice, *SHORT, *sets("guidance.kind=mine")], (0, 1, 2, 130))
    return "" if "__pycache__" in found or "mine.py" in found else found

"""Guidance law that keeps the tractor at standstill."""

LAWS = '''
"""Laws that do not drive their path."""

from typing import Literal

from agrobot_mj.control import GuidanceLaw, Situation
from agrobot_mj.core.signals import Command


class Still(GuidanceLaw):
    """Never moves."""

    kind: Literal["{name}"] = "{name}"

    def update(self, state: None, situation: Situation, dt: float) -> tuple[None, Command]:
        """No speed."""
        return None, Command(steer=0.0, speed=0.0)
'''
AWAY = ("--set", "plant.kind=bicycle", "--set", "duration_s=9", "--set", "path.speed_m_s=1")


def standing(folder, test):
    """Write a plugin file with a guidance law that never moves. Return the file and the kind of the law, which differs
    between tests, because kinds stay registered."""
    name = f"still_{abs(hash(test)) % 10**8}"
    (folder / "laws.py").write_text(LAWS.replace("{name}", name))
    return folder / "laws.py", name

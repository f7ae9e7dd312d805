"""Falsification: search for the smallest failing change of a scenario, and evaluation of neighbouring cases."""

from agrobot_mj.extensions.search.falsify.command import content, falsify
from agrobot_mj.extensions.search.falsify.search import Combination, Falsified, FalsifyQuestion, Varied

__all__ = ["Combination", "Falsified", "FalsifyQuestion", "Varied", "content", "falsify"]

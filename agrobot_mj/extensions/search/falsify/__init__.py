"""Smallest failing change of a scenario: varied keys, search, and evaluation of neighbouring cases."""

from agrobot_mj.extensions.search.falsify.command import content, falsify
from agrobot_mj.extensions.search.falsify.search import Combination, Falsified, FalsifyQuestion, Varied

__all__ = ["Combination", "Falsified", "FalsifyQuestion", "Varied", "content", "falsify"]

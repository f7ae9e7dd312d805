"""The mildest combination that fails: keys with what counts as mild, search, what is about the answer."""

from agrobot_mj.extensions.search.falsify.command import content, falsify
from agrobot_mj.extensions.search.falsify.search import Combination, Falsified, FalsifyQuestion, Varied

__all__ = ["Combination", "Falsified", "FalsifyQuestion", "Varied", "content", "falsify"]

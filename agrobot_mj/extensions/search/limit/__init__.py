"""Limit of a guidance law along one key: failure condition, search over seeds, and result with its reliability."""

from agrobot_mj.extensions.search.limit.question import Counterpart, Found, Question, Tried
from agrobot_mj.extensions.search.limit.search import content, limit

__all__ = ["Counterpart", "Found", "Question", "Tried", "content", "limit"]

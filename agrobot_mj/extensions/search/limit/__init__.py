"""Search for the limit of a guidance law along one key: failure condition, runs with several seeds, and reliability of
the result."""

from agrobot_mj.extensions.search.limit.question import Counterpart, Found, Question, Tried
from agrobot_mj.extensions.search.limit.search import content, limit

__all__ = ["Counterpart", "Found", "Question", "Tried", "content", "limit"]

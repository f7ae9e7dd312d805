"""Search for the value of a key at which a guidance law begins to fail: failure condition, runs with several seeds, and
reliability of the result."""

from agrobot_mj.extensions.search.limit.question import Counterpart, Found, Question, Tried
from agrobot_mj.extensions.search.limit.search import content, limit

__all__ = ["Counterpart", "Found", "Question", "Tried", "content", "limit"]

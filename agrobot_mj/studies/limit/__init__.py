"""The limit of a guidance law along one key: condition of failure, search over seeds, answer with its reliability."""

from agrobot_mj.studies.limit.command import content, limit
from agrobot_mj.studies.limit.question import Counterpart, Found, Question, Tried

__all__ = ["Counterpart", "Found", "Question", "Tried", "content", "limit"]

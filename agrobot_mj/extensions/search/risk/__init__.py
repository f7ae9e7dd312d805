"""The probability of a rare failure: splitting of runs by how close they come to it, answer with its interval."""

from agrobot_mj.extensions.search.risk.command import Risk, content, risk
from agrobot_mj.extensions.search.risk.splitting import RiskQuestion

__all__ = ["Risk", "RiskQuestion", "content", "risk"]

"""Probability of a rare failure by splitting runs that come close to failure, with a confidence interval."""

from agrobot_mj.extensions.search.risk.command import Risk, content, risk
from agrobot_mj.extensions.search.risk.splitting import RiskQuestion

__all__ = ["Risk", "RiskQuestion", "content", "risk"]

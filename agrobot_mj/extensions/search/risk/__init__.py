"""Probability of a rare failure with its confidence interval, estimated by splitting runs that approach failure."""

from agrobot_mj.extensions.search.risk.command import Risk, content, risk
from agrobot_mj.extensions.search.risk.splitting import RiskQuestion

__all__ = ["Risk", "RiskQuestion", "content", "risk"]

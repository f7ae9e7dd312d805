"""A twin of a machine from its logs."""

from agrobot_mj.extensions.logs.twin.twin import Twin, twin
from agrobot_mj.extensions.logs.words import twin_sentences

__all__ = ["Twin", "twin", "twin_sentences"]

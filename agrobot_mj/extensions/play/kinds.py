"""Guidance laws registered by this extension."""

from agrobot_mj.extensions.play.played import Played

KINDS = (Played,)

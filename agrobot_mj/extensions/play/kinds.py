"""Guidance law `played`, which this extension adds to the scenario format."""

from agrobot_mj.extensions.play.played import Played

KINDS = (Played,)

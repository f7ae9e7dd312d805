"""Guidance laws registered by this extension."""

from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.extensions.links.cmd_vel import CmdVel

KINDS = (AgOpenGps, CmdVel)

"""Guidance laws that a learning law may contain."""

from agrobot_mj.control.laws import InnerLaw
from agrobot_mj.extensions.learners.eso import Eso

LawInside = InnerLaw | Eso
"""Guidance laws that contain no other law, selected by `kind`."""

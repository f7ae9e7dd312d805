"""Guidance laws that a learning law accepts as inner law."""

from agrobot_mj.control.laws import InnerLaw
from agrobot_mj.extensions.learners.eso import Eso

LawInside = InnerLaw | Eso  # Guidance laws without an inner law, selected by `kind`

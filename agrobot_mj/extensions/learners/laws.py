"""Guidance laws that learning laws accept as inner laws."""

from agrobot_mj.control.laws import InnerLaw
from agrobot_mj.extensions.learners.eso import Eso

LawInside = InnerLaw | Eso  # Guidance laws without an inner law, selected by `kind`

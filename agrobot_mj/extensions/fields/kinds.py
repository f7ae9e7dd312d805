"""Kinds of this extension."""

from agrobot_mj.extensions.fields.plan_path import FieldPlan

KINDS = (FieldPlan,)
"""Kinds of this extension."""

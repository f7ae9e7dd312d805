"""Path type and metric registered by this extension."""

from agrobot_mj.extensions.fields.plan_path import FieldPlan
from agrobot_mj.extensions.fields.work_metric import FieldWork

KINDS = (FieldPlan, FieldWork)  # Classes of the kinds of this extension

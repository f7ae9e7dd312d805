"""Path type `field_plan` and metric `field_work`, which this extension adds to the scenario format."""

from agrobot_mj.extensions.fields.plan_path import FieldPlan
from agrobot_mj.extensions.fields.work_metric import FieldWork

KINDS = (FieldPlan, FieldWork)  # Classes of the path type and the metric

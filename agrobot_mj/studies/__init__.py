"""Studies of many runs: comparisons, sweeps, reports, and an API for user-defined studies."""

from agrobot_mj.simulation.feasibility import check_tractors
from agrobot_mj.simulation.results import write_json
from agrobot_mj.studies.engine.resume import RunTasks, about, study
from agrobot_mj.studies.engine.tasks import Row, Task

__all__ = ["Row", "RunTasks", "Task", "about", "check_tractors", "study", "write_json"]

"""The engine of all studies: tasks to rows, over processes or Dask, resumed from the folder of the results."""

from agrobot_mj.studies.engine.pool import spread
from agrobot_mj.studies.engine.resume import ROWS, RunTasks, resuming
from agrobot_mj.studies.engine.tasks import Done, Task, base_text, perform
from agrobot_mj.studies.engine.workers import performing

__all__ = ["ROWS", "Done", "RunTasks", "Task", "base_text", "perform", "performing", "resuming", "spread"]

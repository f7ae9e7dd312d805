"""Execution of the tasks of a study by processes or Dask workers. The resulting rows are stored and reused."""

from agrobot_mj.studies.engine.resume import RunTasks, about, study
from agrobot_mj.studies.engine.tasks import Done, Row, Task, base_text, perform
from agrobot_mj.studies.engine.workers import performing, pool_map

__all__ = ["Done", "Row", "RunTasks", "Task", "about", "base_text", "perform", "performing", "pool_map", "study"]

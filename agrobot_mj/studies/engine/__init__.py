"""Execution of the tasks of a study by processes or Dask workers. The resulting rows are stored and reused."""

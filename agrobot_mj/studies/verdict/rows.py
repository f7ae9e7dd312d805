"""Results of a study as JSON lines; what is there is not done again, so that a broken-off study goes on."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from agrobot_mj.studies.pool import spread

Job = TypeVar("Job")
ResultRow = dict[str, Any]


def read_rows(file: Path) -> list[ResultRow]:
    """The rows of a file; none where there is no file. A last line cut short by a kill is left out."""
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    found = []
    for number, line in enumerate(lines, 1):
        try:
            found.append(json.loads(line))
        except ValueError:
            if number < len(lines):
                raise
    return found


def complete(
    file: Path,
    jobs: Mapping[str, Job],
    perform: Callable[[tuple[str, Job]], ResultRow],
    workers: int,
    done: Callable[[], object],
) -> list[ResultRow]:
    """The rows of all jobs, by key; those that `file` lacks are done and added to it.

    A row has its job's key under `key`. `done` is called once a job.
    """
    there = {row["key"]: row for row in read_rows(file)}
    for _ in jobs.keys() & there.keys():
        done()
    file.parent.mkdir(parents=True, exist_ok=True)
    # Written again first, so that a line cut short does not swallow the next.
    file.write_text("".join(json.dumps(row) + "\n" for row in there.values()), encoding="utf-8")
    todo = [(key, job) for key, job in jobs.items() if key not in there]
    with file.open("a", encoding="utf-8") as out:
        for (key, _), row in spread(perform, todo, workers):
            there[key] = row
            out.write(json.dumps(row) + "\n")
            out.flush()
            done()
    return [there[key] for key in jobs]


def select(rows: Iterable[ResultRow], **wanted: Any) -> list[ResultRow]:
    """Rows with these values."""
    return [row for row in rows if all(row.get(name) == value for name, value in wanted.items())]

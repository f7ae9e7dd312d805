"""Identity of a result from logs: digests of the scenario, the logs, the column map, the command options and the
code."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from agrobot_mj.core.identity import PARTS, digest, file_digest, joint_digest, program_digest
from agrobot_mj.core.table_columns import Source
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.scenario.schema import Scenario


def log_identity(scenario: Scenario, sources: Sequence[Source], log_map: LogMap | None = None, **asked: Any) -> str:
    """Return a text that identifies a result by digests of its inputs and of the code. `asked` contains the options
    that affect the result, as JSON values."""
    of = scenario.identity
    said = json.dumps([log_map and log_map.model_dump(mode="json"), asked])
    files = joint_digest([of.files, *map(_content, sources)])
    return str(of._replace(scenario=joint_digest([of.scenario, said]), files=files, program=_program()))


def _content(source: Source) -> str:
    """Return a digest of a log's content, independent of file name and folder."""
    if isinstance(source, Path):
        return file_digest(source)
    table, sink = source.replace_schema_metadata(None).combine_chunks(), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return digest(sink.getvalue().to_pybytes())


@cache
def _program() -> str:
    return program_digest((*PARTS, "extensions/logs"))

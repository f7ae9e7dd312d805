"""A twin of a machine from its logs."""

from agrobot_mj.fieldlogs.twin.page import FILES, summary, write_twin
from agrobot_mj.fieldlogs.twin.twin import Twin, twin

__all__ = ["FILES", "Twin", "summary", "twin", "write_twin"]

"""A twin of a machine from its logs."""

from agrobot_mj.extensions.logs.twin.page import FILES, summary, write_twin
from agrobot_mj.extensions.logs.twin.twin import Twin, twin

__all__ = ["FILES", "Twin", "summary", "twin", "write_twin"]

"""Twin of a machine identified from its logs."""

from agrobot_mj.extensions.logs.twin.twin import Twin, twin

__all__ = ["Twin", "twin"]

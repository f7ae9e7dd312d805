"""Digital twin of a machine: a simulated machine with parameters identified from logs."""

from agrobot_mj.extensions.logs.twin.twin import Twin, twin

__all__ = ["Twin", "twin"]

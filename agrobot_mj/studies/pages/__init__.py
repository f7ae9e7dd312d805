"""Report on the results folder of any command, as a self-contained HTML page."""

from agrobot_mj.studies.pages.report import write_report

__all__ = ["write_report"]

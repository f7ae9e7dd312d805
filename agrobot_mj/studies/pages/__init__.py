"""Reports: a self-contained HTML page for the results folder of any command."""

from agrobot_mj.studies.pages.report import write_report

__all__ = ["write_report"]

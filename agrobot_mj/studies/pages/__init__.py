"""Reports: one self-contained HTML page for a folder of results, whatever made them."""

from agrobot_mj.studies.pages.report import write_report

__all__ = ["write_report"]

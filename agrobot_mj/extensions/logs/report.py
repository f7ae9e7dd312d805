"""Folders of a twin have their report already."""

from agrobot_mj.studies.pages.report import Reports

REPORTS = Reports({"twin.json": "twin has written its report already, report.html there"})

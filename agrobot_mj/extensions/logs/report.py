"""Reports of this extension, except the report of a twin, which is written by the command `twin`."""

from agrobot_mj.studies.pages.report import Reports

REPORTS = Reports({"twin.json": "twin has already written its report, report.html, to this folder"})

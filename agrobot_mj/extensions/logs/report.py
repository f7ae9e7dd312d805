"""Reports of this extension, except the report of a digital twin, which the command `twin` writes."""

from agrobot_mj.studies.pages.report import Reports

REPORTS = Reports({"twin.json": "twin has already written its report, report.html, to this folder"})

"""Reports of this extension. The folder of a twin already contains its report."""

from agrobot_mj.studies.pages.report import Reports

REPORTS = Reports({"twin.json": "twin has already written its report, report.html, to this folder"})

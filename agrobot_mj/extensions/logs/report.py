"""Entry of this extension for the command `report`: a digital twin has no page, because `twin` writes the report."""

from agrobot_mj.studies.pages.report import Reports

REPORTS = Reports({"twin.json": "twin has already written its report, report.html, to this folder"})

"""Requirements on the HTML report of any folder of results."""

import json
import re

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.simulation.results import claim
from agrobot_mj.studies.pages.report import write_report


def page_of(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def charts_of(folder):
    (text,) = re.findall(r"const CHARTS = (\{.*?\});\n", page_of(folder))
    return json.loads(text)


def check_page(folder):
    """Check that the report is a single file without empty charts."""
    text = page_of(folder)
    assert len(text) < 15e6
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    assert re.findall(r"(?:src|href)\s*=\s*[\"']?([^\"'\s>]*)", own) == ["data:,"]
    charts = charts_of(folder)
    assert charts
    for name, chart in charts.items():
        assert f'id="{name}"' in text
        assert chart["data"]
        assert all(len(trace.get("x", trace.get("z", ()))) for trace in chart["data"]), name
        assert chart["layout"]["xaxis"]["title"]["text"]


def check_damage(folder, name, content):
    """Check that a file `name` with the given content is reported as damaged and that no report is written."""
    claim(folder, [name])
    (folder / name).write_text(content)
    with pytest.raises(ScenarioError, match="cannot be reported"):
        write_report(folder)
    assert not (folder / "report.html").exists()

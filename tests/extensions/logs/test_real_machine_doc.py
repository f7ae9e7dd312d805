"""Numbers in paper.md equal those on the page real_machine.md."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_paper_and_real_machine_page_state_equal_numbers():
    text, page = ((ROOT / name).read_text("utf-8") for name in ("paper.md", "docs/extensions/logs/real_machine.md"))
    rows = re.findall(r"^\| (2\w+) \| (\d+%) \| ([\d.]+) \| (\d+%) \| ([\d.]+) \|$", text, re.M)
    row = re.compile(r"^\| (\w+) \| ([^|]+) \| (\d+%) \|[^|]+\|[^|]+\| ([\d.]+) / ", re.M)
    found = {(run, model): numbers for run, model, *numbers in row.findall(page.partition("### Again")[0])}
    assert {run for run, *_ in rows} == {"2W", "2E", "2W85", "2E85"}
    for run, *numbers in rows:
        assert numbers == found[run, "MuJoCo, default tyres"] + found[run, "wheels without slip"]
    recorded, twin = (
        re.search(rf"^\| {passes} \| \d \| (.*?) \|.*\| (.*?) \|$", page, re.M).groups()
        for passes in ("recorded, 0.85 m/s", "twin, 0.85 m/s, predicted")
    )
    said = " ".join(text.split())
    assert (
        f"mean error is {twin[0].replace('(', 'cm (range of four passes ')}, recorded are {recorded[0][:3]} cm" in said
    )
    assert f"offset to the left of {recorded[1][:3]} cm does not come out ({twin[1][:3]} cm)" in said

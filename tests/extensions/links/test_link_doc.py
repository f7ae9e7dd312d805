"""docs/extensions/links/link.md names all existing options, rows of the demo and metrics."""

import re
from dataclasses import replace
from pathlib import Path

import demo
import pytest
import typer.main
from host import parser

from agrobot_mj import run
from agrobot_mj.cli import app
from agrobot_mj.extensions.links.agopengps.channels import RealTime, Replayed
from agrobot_mj.extensions.links.agopengps.link import run_link
from agrobot_mj.extensions.links.agopengps.session import LinkOptions
from agrobot_mj.extensions.links.agopengps.udp import UdpSockets
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.recording.info import summary
from agrobot_mj.scenario.loading import load_scenario

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "extensions" / "links" / "link.md").read_text(encoding="utf-8")


def test_every_option_named_on_the_page_exists():
    command = typer.main.get_command(app).commands["link"]
    known = {option for parameter in command.params for option in parameter.opts}
    known |= {option for action in parser()._actions for option in action.option_strings}
    assert set(re.findall(r"--[a-z][a-z-]*", TEXT)) <= known


def test_every_key_named_on_the_page_exists():
    named = set(re.findall(r"`(?:guidance\.)?([a-z_]+)(?: = |`)", TEXT)) & set(AgOpenGps.model_fields)
    assert {"watchdog_s", "released", "give_up_s", "position_rate_hz", "host", "origin_lat_deg"} <= named


def test_demo_table_on_the_page_has_one_row_per_demo():
    rows = re.findall(r"^\| ([a-z]+: [^|]+) \| `([^`]+)` \|", TEXT, re.MULTILINE)
    assert rows == [(name, host or "-") for name, (_, _, host) in demo.ROWS.items()]


@pytest.mark.parametrize("live", [False, True])
def test_every_link_metric_is_explained_on_the_page(live):
    scenario = load_scenario("straight_line", {"guidance.kind": "agopengps", "duration_s": 0.1})
    with UdpSockets("127.0.0.1", 0, 9) as sockets:
        channel = RealTime(sockets) if live else Replayed([])
        block = run_link(scenario, channel, LinkOptions(start="now")).log.metrics["link"]
    named = set(re.findall(r"`([a-z_]+)`", TEXT)) | {"latency_ms_p95", "latency_ms_worst", "host", "steer_by"}
    assert set(block) <= named


def test_recording_text_names_the_guidance_program_and_link_metrics():
    log = run(load_scenario("straight_line", {"duration_s": 1, "plant.kind": "bicycle"}))
    driven = replace(
        log,
        scenario=load_scenario("straight_line", {"guidance.kind": "agopengps"}),
        metrics={**log.metrics, "link": {"host": "agopengps", "engaged_s": 12.5, "cross_track_rms": None}},
    )
    told = summary(driven)
    assert "guidance **agopengps**, external program (`agrobot-mj link`)" in told
    assert "## link" in told
    assert "| host | agopengps | - |" in told
    assert "| engaged_s | 12.5 | s |" in told

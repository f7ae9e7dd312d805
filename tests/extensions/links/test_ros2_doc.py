"""docs/extensions/links/ros2.md and docs/third_party.md name all existing options, topics, keys and rows."""

import ast
import re
from pathlib import Path

import typer.main

from agrobot_mj.cli import app
from agrobot_mj.extensions.links.cmd_vel import CmdVel
from agrobot_mj.extensions.links.ros2.definitions import RECORDED, TOPICS
from agrobot_mj.scenario.loading import scenario_files

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "extensions" / "links" / "ros2.md").read_text(encoding="utf-8")
THIRD_PARTY = (ROOT / "docs" / "third_party.md").read_text(encoding="utf-8")


def test_every_option_named_on_the_page_exists():
    commands = typer.main.get_command(app).commands
    known = {option for name in ("ros2", "export", "run") for each in commands[name].params for option in each.opts}
    assert set(re.findall(r"--[a-z][a-z0-9-]*", TEXT)) <= known
    given = {option for each in commands["ros2"].params for option in each.opts if option.startswith("--")}
    common = {"--set", "--machine", "--plugin", "--out", "--no-rrd", "--live", "--quiet", "--json", "--duration"}
    assert given - common <= set(re.findall(r"--[a-z][a-z0-9-]*", TEXT))


def test_topic_table_has_every_topic_with_its_type():
    listed = dict(re.findall(r"^\| `(/[a-z_/]+)` \| ([a-z_]+/[A-Za-z]+) \|", TEXT, re.MULTILINE))
    assert listed == TOPICS
    assert set(re.findall(r"`(/[a-z_]+(?:/[a-z]+)?)`", TEXT)) == set(RECORDED)


def test_every_key_named_on_the_page_exists():
    assert set(re.findall(r"`guidance\.([a-z_]+)`", TEXT)) == set(CmdVel.model_fields) - {"kind"}


def test_every_scenario_named_on_the_page_exists():
    rows = re.findall(r"^\| `([a-z_0-9]+)`, \d+ s", TEXT, re.MULTILINE)
    assert len(rows) == 3
    assert set(rows) <= set(scenario_files())


def test_table_of_third_party_laws_has_one_row_per_benchmarked_law():
    tree = ast.parse((ROOT / "examples" / "third_party" / "measure.py").read_text(encoding="utf-8"))
    tables = {node.target.id: node.value for node in tree.body if isinstance(node, ast.AnnAssign)}
    laws, surfaces = ([key.value for key in tables[name].keys] for name in ("LAWS", "SURFACES"))
    assert re.findall(r"^\| ([^|`]+) \| (?:\d|unfinished)", THIRD_PARTY, re.MULTILINE) == laws
    assert f"| law | {' | '.join(surfaces)} |" in THIRD_PARTY

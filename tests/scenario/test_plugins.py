"""Plugin classes of every family, and rejection of invalid classes with the reason.

Tests that register a class run in separate processes, because a registration lasts until the end of a process.
"""

import sys
from pathlib import Path
from typing import Literal

import pytest
import typer.main
from processes import command, program

from agrobot_mj import load_scenario, run
from agrobot_mj.cli import app
from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Command
from agrobot_mj.metrics import METRICS
from agrobot_mj.scenario.reference import families

HEAD = "from typing import Literal\nfrom agrobot_mj import load_scenario, register, run\n"
MEMBERS = {
    "terrain": ("agrobot_mj.terrain", "Flat"),
    "path": ("agrobot_mj.paths", "Line"),
    "controller": ("agrobot_mj.control", "Pd"),
    "guidance": ("agrobot_mj.control", "Kinematic"),
    "estimator": ("agrobot_mj.estimation", "Ekf"),
    "plant.tyre": ("agrobot_mj.tyres", "Linear"),
    "implement": ("agrobot_mj.machine.implements", "Drawn"),
}


def test_plugin_of_every_family_can_be_loaded_overridden_and_saved(tmp_path):
    code = ""
    for k, (key, (module, base)) in enumerate(MEMBERS.items()):
        code += f"""
from {module} import {base} as Base{k}
@register
class Own{k}(Base{k}):
    \"\"\"A {key} of one's own.\"\"\"
    kind: Literal["own"] = "own"
    extra_m: float = 1.0
    \"\"\"A further key [m].\"\"\"
s = load_scenario("straight_line", {{"{key}.kind": "own", "{key}.extra_m": 2.0}})
part = s
for step in "{key}".split("."):
    part = getattr(part, step)
assert type(part) is Own{k} and part.extra_m == 2.0, part
open("again.toml", "w").write(s.to_toml())
assert load_scenario("again.toml") == s
"""
    code += """
from agrobot_mj.faults import GnssLoss
@register
class OwnLoss(GnssLoss):
    \"\"\"A fault of one's own.\"\"\"
    kind: Literal["own_loss"] = "own_loss"
(fault,) = load_scenario("straight_line", {"fault": [{"kind": "own_loss", "end_s": 1.0}]}).fault
assert type(fault) is OwnLoss
from agrobot_mj.core.errors import ScenarioError
try:
    load_scenario("straight_line", {"terrain.kind": "own", "terrain.extra_n": 1.0})
except ScenarioError as error:
    assert "terrain.extra_n: unknown key; did you mean 'extra_m'?" in str(error), error
else:
    raise AssertionError
keys = ("guidance", "controller", "estimator", "path")
short = {"duration_s": 1, "plant.kind": "bicycle"}
log = run(load_scenario("straight_line", {**short, **{f"{key}.kind": "own" for key in keys}}))
same = run(load_scenario("straight_line", {**short, "controller.kind": "pd", "gains": "paper"}))  # those of the class
assert log.outcome == "completed"
assert log.signals.column("x").equals(same.signals.column("x"))
"""
    done = program(tmp_path, HEAD + code)
    assert (done.returncode, done.stderr) == (0, "")


def test_measurement_of_a_plugin_sensor_is_passed_to_the_estimator(tmp_path):
    code = """
from agrobot_mj.sensors import Sensor
@register
class FuelGauge(Sensor):
    \"\"\"Level of the tank.\"\"\"
    full_l: float = 30.0
    \"\"\"Volume of the tank [l].\"\"\"
    def init(self, seed):
        return 0
    def measure(self, state, truth, conditions, dt):
        return state + 1, self.full_l - 0.01 * state
s = load_scenario("straight_line", {"sensors.fuel_gauge.full_l": 20.0, "duration_s": 1, "plant.kind": "bicycle"})
assert s.sensors.fuel_gauge.full_l == 20.0
assert load_scenario("straight_line").sensors.fuel_gauge.full_l == 30.0
from agrobot_mj.estimation import Ekf
seen = []
class Watching(Ekf):
    \"\"\"Looks at the gauge.\"\"\"
    kind: Literal["watching"] = "watching"
    def update(self, state, measurement, dt):
        seen.append(measurement.readings["fuel_gauge"])
        return super().update(state, measurement, dt)
register(Watching)
run(s.changed({"estimator.kind": "watching"}))
assert seen[:2] == [20.0, 19.99], seen[:3]
"""
    done = program(tmp_path, HEAD + code)
    assert (done.returncode, done.stderr) == (0, "")


def test_suggestions_include_keys_of_plugins_registered_later(tmp_path):
    code = (
        HEAD
        + """
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.terrain import Flat

def told():
    try:
        load_scenario("straight_line", {"terrain.ditch_m": 0.4})
    except ScenarioError as error:
        return str(error)
    raise AssertionError

assert "swamp" not in told()

@register
class Swamp(Flat):
    "A swamp."
    kind: Literal["swamp"] = "swamp"
    ditch_m: float = 0.3
    "Depth of its ditches [m]."

assert "it is a key of kind = 'swamp'" in told(), told()
"""
    )
    done = program(tmp_path, code)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("file", "message"),
    [
        (None, "own.py: no such file"),
        ("def", "own.py: line 1: SyntaxError"),
        ("1 / 0", "own.py: ZeroDivisionError: division by zero"),
        ("import no_such_thing", "own.py: ModuleNotFoundError: No module named 'no_such_thing'"),
        (
            "from typing import Literal\nfrom agrobot_mj.paths import Line\n"
            'class A(Line):\n    """A."""\n    kind: Literal["circle"] = "circle"',
            "own.py: register: path.kind 'circle' already exists; choose another",
        ),
        (
            "from typing import Literal\nfrom agrobot_mj.core.spec import Spec\n"
            'class A(Spec):\n    """A."""\n    kind: Literal["a"] = "a"',
            "own.py: register: A: the class has no known base class; derive it from one of ",
        ),
        (
            "from typing import Literal\nfrom agrobot_mj.paths import Line\n"
            'class A(Line):\n    """A."""\n    kind: Literal["a"] = "a"\n    b_m: float',
            "own.py: register: A: every key needs a valid default (b_m)",
        ),
        (
            "from typing import Literal\nfrom agrobot_mj.paths import Line\n"
            'class A(Line):\n    """A."""\n    kind: Literal["short"] = "long"\n    length_m: float = "9"',
            "own.py: register: A: every key needs a valid default (kind, length_m)",
        ),
        (
            "from typing import Literal\nfrom agrobot_mj.paths import Line\n"
            'class A(Line):\n    """A."""\n    kind: Literal["a", "b"] = "a"',
            'own.py: register: A: the class needs a kind: Literal["my_kind"] = "my_kind"',
        ),
        (
            "from typing import Any, Literal\nfrom agrobot_mj.paths import Line\n"
            'class A(Line):\n    """A."""\n    kind: Literal["a"] = "a"\n    b: Any = object()',
            "own.py: register: A: the class has a key that TOML cannot represent (",
        ),
        (
            "from typing import Literal\nfrom agrobot_mj.control import GuidanceLaw\n"
            'class A(GuidanceLaw):\n    """A."""\n    kind: Literal["a"] = "a"',
            "own.py: register: A: the class lacks update, required by its base class",
        ),
        ("raise SystemExit(3)", "own.py: SystemExit: 3"),
    ],
)
def test_invalid_plugin_gives_one_message_and_registers_nothing(tmp_path, call, file, message):
    if file is not None:
        (tmp_path / "own.py").write_text(file)
    before = {key: list(kinds) for key, kinds in families().items()}
    status, _, err = call("list", "--kinds", "--plugin", "own.py")
    assert status == 2
    assert err.startswith(f"--plugin {message}")
    assert err.count("\n") == 1
    assert {key: list(kinds) for key, kinds in families().items()} == before


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda state: None, "update must return its state and a Command, got None"),
        (lambda state: (state, 0.1), "update must return its state and a Command, got (None, 0.1)"),
        (
            lambda state: (state, Command(0.1, 1.0), 3),
            "update must return its state and a Command, got (None, Command(",
        ),
        (lambda state: (state, Command("left", 1.0)), "returned a non-numeric command: Command(steer='left'"),
        (lambda state: (state, Command(None, None)), "returned a non-numeric command: Command(steer=None"),
        (lambda state: (state, Command([0.1] * 1000, 1.0)), " ... "),
        (lambda state: sys.exit(3), "code of a plugin ended the run with SystemExit"),
    ],
)
def test_error_for_a_plugin_law_states_its_invalid_return_value(answer, message):
    class Mine(GuidanceLaw):
        """Guidance law with an invalid return value."""

        kind: Literal["mine"] = "mine"

        def update(self, state, situation, dt):
            return answer(state)

    scenario = load_scenario("straight_line", {"duration_s": 1, "plant.kind": "bicycle"})
    with pytest.raises(ScenarioError) as error:
        run(scenario.model_copy(update={"guidance": Mine()}))
    assert message in str(error.value)
    assert len(str(error.value)) < 400


OWN_METRIC = """
from typing import ClassVar
from agrobot_mj.core.signals import Column
from agrobot_mj.metrics import METRICS, Metric
@register
class Twice(Metric):
    "Twice the error."
    kind: Literal["twice"] = "twice"
    columns: ClassVar = (Column("twice_rms", "m", "twice lateral_rms"),)
    def evaluate(self, view):
        return {"twice_rms": 2 * float((view.column("e_lateral") ** 2).mean() ** 0.5)}
"""


def test_plugin_metric_is_computed_for_every_run_and_listed(tmp_path):
    code = """
from agrobot_mj.scenario.reference import kinds_text
metrics = run(load_scenario("straight_line", {"duration_s": 3, "plant.kind": "bicycle"})).metrics
assert metrics["twice_rms"] == 2 * metrics["lateral_rms"] > 0, metrics
assert kinds_text().splitlines()[-1].split() == ["metric", "twice", "Twice", "the", "error."]
register(Twice)
assert len([one for one in METRICS if one.kind == "twice"]) == 1
"""
    done = program(tmp_path, HEAD + OWN_METRIC + code)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["twice"] = "twice"', '["progress"] = "progress"', "register: metric 'progress' already exists; choose"),
        ("twice_rms", "xte_rms", "register: metric 'xte_rms' already exists; choose another"),
        ("evaluate", "evaluated", "register: Twice: the class lacks evaluate, required by its base class"),
    ],
)
def test_plugin_metric_with_an_existing_name_is_rejected(tmp_path, call, old, new, message):
    (tmp_path / "own.py").write_text(HEAD + OWN_METRIC.replace(old, new))
    before = list(METRICS)
    status, _, err = call("list", "--kinds", "--plugin", "own.py")
    assert (status, before) == (2, METRICS)
    assert message in err


def test_control_characters_in_plugin_docstrings_are_not_printed(tmp_path):
    code = (
        HEAD
        + """
from agrobot_mj.terrain import Flat
from agrobot_mj.scenario.reference import explain_key, kinds_text
@register
class Own(Flat):
    "Field. \x1b]0;pwn\x07"
    kind: Literal["own"] = "own"
    extra_m: float = 1.0
    "A further key \x1b[2J\u202e[m]."
print(kinds_text(), explain_key("terrain.extra_m"))
"""
    )
    done = program(tmp_path, code)
    assert done.returncode == 0, done.stderr
    assert "Field." in done.stdout
    assert "A further key" in done.stdout
    assert not set("\x1b\x07\u202e") & set(done.stdout)


LAW = """
from typing import Literal
from agrobot_mj import register
from agrobot_mj.control import Stanley
@register
class Own(Stanley):
    "Own law."
    kind: Literal["own"] = "own"
"""


def test_every_command_on_scenarios_or_kinds_accepts_plugins():
    """Commands on recordings are excluded. A command with a scenario argument must have the option."""
    verbs = typer.main.get_command(app).commands
    without = {verb for verb, made in verbs.items() if not any("--plugin" in option.opts for option in made.params)}
    assert without == {"view", "snapshot"}
    arguments = {
        option.metavar for verb in without for option in verbs[verb].params if option.param_type_name == "argument"
    }
    assert arguments == {"FILE.rrd"}


def test_study_commands_accept_plugins(tmp_path):
    """Tyre plugins are tested in tests/docs/test_plugins_doc.py."""
    (tmp_path / "law.py").write_text(LAW, encoding="utf-8")
    short = ("--set", "duration_s=1", "--plants", "bicycle", "--no-rrd", "--out", "compared")
    done = command(tmp_path, "compare", "straight_line", "--plugin", "law.py", "--guidance", "own", *short)
    assert done.returncode == 0, done.stderr
    assert '"own"' in (tmp_path / "compared" / "comparison.json").read_text()


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_plugin_files_of_equal_name_in_two_folders_are_both_loaded(tmp_path, order):
    for folder, kind in (("left", "port"), ("right", "starboard")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "law.py").write_text(LAW.replace('"own"', f'"{kind}"'), encoding="utf-8")
    plugins = [word for folder in order for word in ("--plugin", f"{folder}/law.py")]
    done = command(tmp_path, "list", "--kinds", *plugins)
    assert done.returncode == 0, done.stderr
    listed = [line.split()[:2] for line in done.stdout.splitlines() if line.split()[1] in ("port", "starboard")]
    assert sorted(listed) == [["guidance", "port"], ["guidance", "starboard"]]


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_kind_defined_by_two_plugin_files_of_equal_name_is_rejected(tmp_path, order):
    for folder in order:
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "law.py").write_text(LAW.replace("Own law", f"Law on the {folder}"), encoding="utf-8")
    first, second = (str(Path(folder, "law.py")) for folder in order)
    done = command(tmp_path, "run", "circle", "--plugin", first, "--plugin", second, "--out", "out")
    assert (done.returncode, done.stdout) == (2, "")
    expected = f"--plugin {second}: register: guidance.kind 'own' already exists in {tmp_path / first}; choose another"
    assert done.stderr.strip() == expected
    assert not (tmp_path / "out").exists()


def test_plugin_file_given_by_two_paths_is_loaded_once(tmp_path):
    (tmp_path / "law.py").write_text(LAW, encoding="utf-8")
    (tmp_path / "link.py").symlink_to("law.py")
    done = command(tmp_path, "list", "--kinds", "--plugin", "law.py", "--plugin", "link.py")
    assert done.returncode == 0, done.stderr


def test_list_of_kinds_shows_each_kind_of_a_plugin_once(tmp_path):
    parts = Path(__file__).parents[2] / "examples" / "plugin_template"
    code = f"""
import sys
sys.path.insert(0, {str(parts)!r})
import my_parts
from agrobot_mj.scenario.reference import kinds_text
for part in (my_parts.TwoGains, my_parts.Compass, my_parts.SteeringTravel):
    register(part)
rows = [line.split()[:2] for line in kinds_text().splitlines()]
for row in (["guidance", "my_gains"], ["sensors", "compass"], ["metric", "steering_travel"]):
    assert [other for other in rows if other[1] == row[1]] == [row], rows
"""
    done = program(tmp_path, HEAD + code)
    assert (done.returncode, done.stderr) == (0, "")

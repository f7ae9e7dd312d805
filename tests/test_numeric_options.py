"""Options that take a number refuse what is none, or has no end, before anything runs."""

import click
import pytest
from typer.main import get_command

from agrobot_mj import cli
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies import tune as study
from agrobot_mj.studies.limit.search import MOST_CONFIDENT, Question, check
from agrobot_mj.studies.tune import check_size, tune

COMMANDS = get_command(cli.app).commands
REAL = [
    pytest.param(command, option, id=f"{name} {option.opts[0]}")
    for name, command in COMMANDS.items()
    for option in command.params
    if option.type.name.startswith("float")
]
ENDLESS = {"--to", "--wait"}
"""Options that may be infinite."""


@pytest.mark.parametrize(("command", "option"), REAL)
@pytest.mark.parametrize("text", ["nan", "-nan", "inf", "-inf", "9" * 400])
def test_no_option_takes_what_is_no_number(command, option, text):
    if "nan" not in text and ENDLESS & set(option.opts):
        return
    with pytest.raises(click.BadParameter):
        option.process_value(click.Context(command), text)


def test_there_are_such_options():
    assert len(REAL) >= 11


LIMIT = {"key": "path.speed_m_s", "start": 1.0, "stop": 2.0, "until": "xte_rms > 1"}


@pytest.mark.parametrize(
    "odd",
    [
        *({"tolerance": value} for value in (float("nan"), float("inf"), 0.0, -1.0)),
        *({"confidence": value} for value in (float("nan"), 0.0, 1.0, 0.9999999999999999)),
        *({"reliability": value} for value in (float("nan"), 0.0, 1.0)),
        {"start": -1e308, "stop": 1e308},
    ],
    ids=str,
)
def test_a_limit_is_asked_with_numbers_that_can_be_answered(odd, monkeypatch):
    monkeypatch.setattr("agrobot_mj.studies.limit.search.metric_names", lambda scenario: pytest.fail("a run"))
    with pytest.raises(ScenarioError, match=rf"--(tolerance|range).*(at most|between 0 and {MOST_CONFIDENT}|wide)"):
        check(Question(**{**LIMIT, **odd}), {"paper": load_scenario("circle")})


@pytest.mark.parametrize(("budget", "seeds"), [(64, 200_000), (10**9, 1), (8, 10**400)])
def test_a_search_too_large_is_refused_before_its_cases_are_built(budget, seeds, monkeypatch):
    monkeypatch.setattr(study, "tuning_cases", lambda *_: pytest.fail("built"))
    with pytest.raises(ScenarioError, match=r"--budget .* --seeds .*: more than 100,000 runs; take fewer"):
        tune(load_scenario("straight_line", {"guidance.kind": "stanley"}), budget, seeds)


def test_a_search_of_ordinary_size_is_none_too_large():
    check_size(64, 20)


def test_a_shard_of_too_many_digits_is_told(call):
    status, _, err = call("sweep", "x.toml", "--shard", f"1/{'9' * 5000}")
    assert (status, "write part and number of parts" in err) == (2, True)

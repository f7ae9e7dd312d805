"""Options that take a number refuse what is none, or has no end, before anything runs."""

from typing import get_args, get_type_hints

import pytest
from typer.main import get_command

from agrobot_mj import cli
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.limit.question import MOST_CONFIDENT, Question, check
from agrobot_mj.extensions.search.tune import check_size, tune
from agrobot_mj.extensions.search.tuning_cases import read_tuning
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies import tune as study


def real_options():
    """(command, option) of every option that takes a real number."""
    for command in cli.app.registered_commands:
        options = {option.name: option.opts[0] for option in get_command(cli.app).commands[command.name].params}
        for name, hint in get_type_hints(command.callback, include_extras=True).items():
            taken, *_ = get_args(hint) or (hint,)
            if taken is float or float in get_args(taken):
                yield command.name, options[name]


REAL = list(real_options())
ENDLESS = {"--to", "--wait"}
"""Options that may be infinite."""
GIVEN = {"limit": ("circle", "--key", "seed", "--range", "1:2", "--until", "x")}
"""What a command needs besides a source."""


@pytest.mark.parametrize(("command", "option"), REAL)
@pytest.mark.parametrize("text", ["nan", "-nan", "inf", "-inf", "9" * 400])
def test_no_numeric_option_accepts_nan(call, command, option, text):
    if "nan" not in text and option in ENDLESS:
        return
    status, _, err = call(command, *GIVEN.get(command, ("circle",)), f"{option}={text}")
    assert (status, f"'{option}'" in err) == (2, True), err


def test_numeric_options_are_found():
    assert {"--tolerance", "--confidence", "--to", "--from", "--share", "--wait"} <= {option for _, option in REAL}


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
def test_a_limit_accepts_only_answerable_numbers(odd, monkeypatch):
    monkeypatch.setattr(
        "agrobot_mj.extensions.search.limit.question.metric_names", lambda scenario: pytest.fail("a run")
    )
    with pytest.raises(ScenarioError, match=rf"--(tolerance|range).*(at most|between 0 and {MOST_CONFIDENT}|wide)"):
        check(Question(**{**LIMIT, **odd}), {"paper": load_scenario("circle")})


@pytest.mark.parametrize(("budget", "seeds"), [(64, 200_000), (10**9, 1), (8, 10**400)])
def test_refuses_too_large_a_search_before_building_cases(budget, seeds, monkeypatch, tmp_path):
    monkeypatch.setattr(study, "tuning_cases", lambda *_: pytest.fail("built"))
    with pytest.raises(ScenarioError, match=r"--budget .* --seeds .*: more than 100,000 runs; take fewer"):
        tune(
            load_scenario("straight_line", {"guidance.kind": "stanley"}),
            read_tuning("surfaces"),
            tmp_path,
            budget,
            seeds,
        )


def test_accepts_a_search_of_ordinary_size():
    check_size(read_tuning("surfaces"), 64, 20)


def test_a_shard_of_too_many_digits_is_reported(call):
    status, _, err = call("sweep", "x.toml", "--shard", f"1/{'9' * 5000}")
    assert (status, "write part and number of parts" in err) == (2, True)

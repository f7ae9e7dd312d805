"""Numeric options reject text, NaN and infinity before any run."""

from typing import get_args, get_type_hints

import pytest
from removed import is_there
from typer.main import get_command

from agrobot_mj import cli


def real_options():
    """Yield command and option for every option with a real number."""
    for command in cli.app.registered_commands:
        options = {option.name: option.opts[0] for option in get_command(cli.app).commands[command.name].params}
        for name, hint in get_type_hints(command.callback, include_extras=True).items():
            taken, *_ = get_args(hint) or (hint,)
            if taken is float or float in get_args(taken):
                yield command.name, options[name]


REAL = list(real_options())
ENDLESS = {"--to", "--wait"}  # Options that may be infinite
GIVEN = {"limit": ("circle", "--key", "seed", "--range", "1:2", "--until", "x")}
"""Required arguments of each command, in addition to the tested option."""


@pytest.mark.parametrize(("command", "option"), REAL)
@pytest.mark.parametrize("text", ["nan", "-nan", "inf", "-inf", "9" * 400])
def test_no_numeric_option_accepts_nan(call, command, option, text):
    if "nan" not in text and option in ENDLESS:
        return
    status, _, err = call(command, *GIVEN.get(command, ("circle",)), f"{option}={text}")
    assert (status, f"'{option}'" in err) == (2, True), err


def test_check_finds_the_numeric_options_of_all_commands():
    known = {("limit", "--tolerance"), ("limit", "--confidence"), ("risk", "--least"), ("link", "--wait")}
    known |= {("twin", "--to"), ("twin", "--from"), ("twin", "--share")}
    assert {each for each in known if is_there(each[0])} <= set(REAL)


def test_shard_number_with_too_many_digits_is_reported(call):
    status, _, err = call("sweep", "x.toml", "--shard", f"1/{'9' * 5000}")
    assert (status, "must have the form PART/PARTS" in err) == (2, True)

"""Commands for writing scenarios: lists, explanations of keys, a scenario template, and the JSON schema."""

import tomllib
from shlex import quote
from typing import Annotated

import typer

from agrobot_mj.cli.options import Answer, utf8
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import machine_files, scenario_files, sweep_files


def list_(
    kinds: Annotated[bool, typer.Option("--kinds", help="List the kinds of every part of a scenario.")] = False,
    sweeps: Annotated[bool, typer.Option("--sweeps", help="List the sweeps for `agrobot-mj sweep`.")] = False,
    machines: Annotated[bool, typer.Option("--machines", help="List the machines for `--machine`.")] = False,
) -> Answer:
    """List the scenarios shipped with the package."""
    if kinds + sweeps + machines > 1:
        raise ScenarioError("list: --kinds, --sweeps and --machines are mutually exclusive; specify only one of them")
    if kinds:
        from agrobot_mj.scenario.reference import kinds_text, known_kinds

        return Answer({"kinds": [row._asdict() for row in known_kinds()]}, kinds_text())
    noun, files = "scenarios", scenario_files()
    if sweeps or machines:
        noun, files = ("sweeps", sweep_files()) if sweeps else ("machines", machine_files())
    # Read as plain TOML, because validation of all scenarios takes seconds.
    titles = {name: tomllib.loads(path.read_text(encoding="utf-8")).get("title", "") for name, path in files.items()}
    width = max(map(len, titles))
    rows = [{"name": name, "title": title} for name, title in titles.items()]
    return Answer({noun: rows}, "\n".join(f"{name:{width}}  {title}" for name, title in titles.items()))


def explain(
    key: Annotated[str, typer.Argument(metavar="[KEY]", help="A dotted key, e.g. plant.tyre.kind.")] = "",
) -> None:
    """Explain a scenario key: unit, default, range, kinds.

    A word that is not a key is searched for in the names of keys, then in their descriptions.
    """
    from agrobot_mj.scenario.reference import explain_key

    print(explain_key(key))


def init(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario and of its file.")]) -> None:
    """Write a commented scenario file as a template."""
    from agrobot_mj.scenario.template import write_template

    path = write_template(utf8(name, "init"))
    shown = quote(f"./{path}" if str(path).startswith("-") else str(path))
    print(f"{path}: created; run it with `agrobot-mj run {shown}`")


def schema() -> None:
    """Print the JSON schema of scenario files for editors."""
    import json

    from agrobot_mj.scenario.reference import json_schema

    print(json.dumps(json_schema(), indent=1))

"""Commands of the test bench: tyre rig, validation manoeuvres and data sheets."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agrobot_mj.cli.options import Answer, Out, Quiet, results_folder, utf8
from agrobot_mj.cli.output import print_hints, say
from agrobot_mj.cli.panels import help_entry

if TYPE_CHECKING:
    from agrobot_mj.extensions.bench.manoeuvres.base import Check


def rig(
    tyre: Annotated[str, typer.Argument(metavar="TYRE", help="Kind of a tyre, e.g. magic_formula, or a scenario.")],
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Measure one tyre on the test rig. Writes force curves and figures."""
    from agrobot_mj.extensions.bench.rig import rig_command

    folder = results_folder(out, f"rig-{Path(tyre).stem}")
    for path in rig_command(tyre, folder):
        if not quiet:
            say(path)


def validate(
    out: Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Run shorter manoeuvres, half a minute in total.")] = False,
    quiet: Quiet = False,
) -> None:
    """Compare simulated manoeuvres with theoretical results.

    The exit status is 1 if a result is outside its acceptance band.
    """
    from agrobot_mj.extensions.bench.manoeuvres.suite import validate as drive_all

    def tell(name: str, checks: "list[Check]", duration: float) -> None:
        passed = sum(check.passed for check in checks)
        if not quiet:
            say(f"{name:20} {passed:3} of {len(checks):3} checks passed, {duration:.0f} s")

    folder = results_folder(out, "validation")
    failed = [check for check in drive_all(folder, quick, tell) if not check.passed]
    if not quiet:
        say(f"table and figures: {folder}")
    for check in failed:
        print(check.line, file=sys.stderr)
    if failed:
        raise typer.Exit(1)


def machine(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name from `agrobot-mj list --machines`, or a file.")],
) -> Answer:
    """Print the data sheet of a machine.

    All numbers are measured in the simulator, without an implement, on firm ground. The machine parameters follow, each
    with its basis: measured, printed, identified or assumed.
    """
    from agrobot_mj.extensions.bench.datasheet import Measured, bases, basis_text, data_sheet, sheet_text
    from agrobot_mj.scenario.loading import load_scenario

    name = utf8(name, "machine")
    scenario = load_scenario("straight_line", {"machine": name})
    print_hints([scenario], quiet=False)
    sheet = list[Measured]()
    for measured in data_sheet(name):
        sheet.append(measured)
        say(sheet_text(measured))
    parameters = list(bases(name, scenario))
    for parameter in parameters:
        say(basis_text(parameter))
    rows = [parameter._asdict() for parameter in parameters]
    return Answer({"machine": name, "sheet": [measured.written for measured in sheet], "parameters": rows}, "")


COMMANDS = {
    validate: help_entry("Check", "validate --quick", "validate --out runs/validation"),
    machine: help_entry("Check", "machine row_crop", "machine compact --json", advanced=True),
    rig: help_entry("Check", "rig soil", "rig magic_formula --out runs/tyre", advanced=True),
}

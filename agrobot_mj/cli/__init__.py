"""The command line: typer only. Every command loads, calls one function, and prints.

Exit status: 0 the run ended as its scenario expects; 1 it ended otherwise; 2 bad input, told in one message without a
traceback. A command imports what it needs when it is called, so that `--help` and `list` answer at once.
"""

import sys

from agrobot_mj.cli.app import app
from agrobot_mj.core.errors import ScenarioError

__all__ = ["app", "main"]


def main() -> None:
    """Entry point: bad input ends with status 2 and one message."""
    try:
        app()
    except ScenarioError as error:
        message = str(error)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        raise SystemExit(1) from None
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        message = f"{place}{error.strerror or error}"
    print(message, file=sys.stderr)
    raise SystemExit(2)

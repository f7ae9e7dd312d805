"""What commands print: results on stdout, which may be closed or full without harm to a finished run."""

import sys


def say(text: object) -> None:
    """Print a result; told on stderr where stdout takes nothing."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        pass
    except OSError as error:
        print(f"stdout: cannot be written: {error.strerror}", file=sys.stderr)

"""One line per package out of what `pip install` says, read from stdin as it comes: how many there are, which is next.

    { pip install -r FILE || echo FAILED; } | python scripts/pip_progress.py [FILE]

FILE is a lock, which says how many packages there will be. The exit status is 1 if a line FAILED comes; pip's errors
are on stderr and pass by. Nothing but the standard library, since nothing else is installed yet.
"""

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

FAILED = "FAILED"


def progress(lines: Iterable[str], total: int) -> Iterator[str]:
    """The lines to print for pip's; `total` is the number of packages, 0 where it is not known."""
    collected = fetched = 0

    def counted(number: int) -> str:
        return f"    {number:3} of {total}" if total else f"    {number:3}"

    for line in lines:
        first, _, rest = line.strip().partition(" ")
        if first == "Ignoring":  # of another system or Python
            total -= 1
        elif line.startswith("Requirement already"):
            collected, fetched = collected + 1, fetched + 1
        elif first == "Collecting":
            collected += 1
            yield f"{counted(collected)}  {rest.partition(' ')[0]}"
        elif line.startswith(("Downloading", "Using cached")):  # after all are known; before, pip indents the line
            fetched += 1
            yield f"{counted(fetched)}  {line.strip()}"
        elif line.startswith("Installing collected"):
            yield "    unpacking them"


def packages(lock: str) -> int:
    """How many packages a lock names."""
    return len(re.findall(r"^[A-Za-z0-9][^\s=]*==", lock, re.MULTILINE))


def main() -> None:
    """Read pip's lines and print ours."""
    failed: list[str] = []

    def read() -> Iterator[str]:
        for line in sys.stdin:
            failed.extend([line] if line.strip() == FAILED else [])
            yield line

    total = packages(Path(sys.argv[1]).read_text("utf-8")) if len(sys.argv) > 1 else 0
    for text in progress(read(), total):
        print(text, flush=True)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()

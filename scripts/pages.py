"""Measured blocks of the documentation: python scripts/pages.py PAGE [PART ...] [--only-draw] ...

Runs what is missing, draws the figures, and writes tables with version, commit and code digest into the pages. What was
broken off goes on. PAGE is a verb of the Makefile, which says what each takes; `PAGE --help` lists its parts.
"""

import sys
from importlib import import_module

from sweeps import Study

from agrobot_mj.core.errors import ScenarioError

PAGES = {
    "acquisition": ("acquisition", ("guidance_tables",)),
    "estimators": ("estimators", ("estimators",)),
    "findings": ("findings", ("findings", "findings_tables")),
    "gains": ("gains", ("guidance_tables",)),
    "machines": ("machines", ("machines",)),
    "performance": ("performance", ("performance",)),
    "safety": ("safety", ("safety",)),
}
"""Module of scripts/measured/ with the parts, and names of the pages, by verb."""


def main(arguments: list[str]) -> None:
    """Write the parts that are asked for, each as soon as it is there."""
    verb, *options = arguments or [""]
    if verb not in PAGES:
        raise SystemExit(f"python scripts/pages.py PAGE, one of {', '.join(PAGES)}")
    name, pages = PAGES[verb]
    module = import_module(f"measured.{name}")
    study = Study(verb, pages, list(module.PARTS), module.__doc__, options)
    try:
        for part in study.parts:
            study.write(part, module.PARTS[part](study))
    except ScenarioError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main(sys.argv[1:])

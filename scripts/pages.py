"""Write the measured blocks of the documentation: python scripts/pages.py PAGE [PART ...] [--only-draw] ...

The script simulates missing runs, draws figures, and writes tables with the version, commit and source hash to pages.
The same command continues after an interruption. PAGE is a target of the Makefile; `PAGE --help` lists its parts.
"""

import sys
from importlib import import_module

from sweeps import Study

from agrobot_mj.core.errors import ScenarioError

PAGES = {name: (name,) for name in ("machines", "performance")}
PAGES |= {name: (name, f"{name}_tables") for name in ("estimators", "findings", "safety")}
PAGES |= {"fields": ("field_studies",)}
PAGES |= dict.fromkeys(("acquisition", "gains"), ("guidance_tables",))
"""Names of the pages that each target of the Makefile writes. Each target is also a module in scripts/measured/."""


def main(arguments: list[str]) -> None:
    verb, *options = arguments or [""]
    if verb not in PAGES:
        raise SystemExit(f"python scripts/pages.py PAGE, one of {', '.join(PAGES)}")
    module = import_module(f"measured.{verb}")
    study = Study(verb, PAGES[verb], list(module.PARTS), module.__doc__, options)
    try:
        for part in study.parts:
            study.write(part, module.PARTS[part](study))
    except ScenarioError as error:
        raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main(sys.argv[1:])

"""Figures beside numbers: they are left out, with a word on how to have them, where matplotlib is not installed.

matplotlib is the extra `figures`; modules that draw are imported by those that ask here first.
"""

import sys
from functools import cache
from importlib import import_module

ADVICE = "figures are left out: matplotlib is not installed; pip install 'agrobot-mj[figures]'"


@cache
def can_draw() -> bool:
    """Whether figures can be drawn; where they cannot, says so on stderr, once a process."""
    try:
        import_module("matplotlib")
    except ImportError:
        print(ADVICE, file=sys.stderr)
        return False
    return True

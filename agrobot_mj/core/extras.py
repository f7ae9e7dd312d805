"""Packages of an extra, which the base package does without."""

from importlib import import_module
from typing import Any

from agrobot_mj.core.errors import ScenarioError


def required(module: str, extra: str, purpose: str) -> Any:
    """The module. Raises `ScenarioError` with the command that installs the extra where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        missing = f" ({error})" if not isinstance(error, ModuleNotFoundError) else ""
        package = module.partition(".")[0]
        raise ScenarioError(f'{purpose} needs {package}{missing}; pip install "agrobot-mj[{extra}]"') from None

"""Scenarios: schema of the TOML files, overrides by dotted key, and loading of scenario files."""

from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.scenario.plugins import load_installed
from agrobot_mj.scenario.schema import Scenario

__all__ = ["Scenario", "load_scenario", "scenario_files"]

load_installed()  # registered here, so that all users of the schema see these kinds

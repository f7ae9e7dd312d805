"""Scenario: one experiment as data. Schema of the TOML files, overrides by dotted key, loading."""

from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.scenario.plugins import load_installed
from agrobot_mj.scenario.schema import Scenario

__all__ = ["Scenario", "load_scenario", "scenario_files"]

load_installed()  # here, so that nobody meets the schema without them

"""Effort and cost of field work: energy, slip, rut depth, and costs of overlaps, gaps and time."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.simulation.log import Log

SLOWEST_M_S = 0.2  # Minimum speed at which slip is evaluated [m/s]
DRIVEN = ("rl", "rr")  # Names of the driven wheels, which are the rear wheels of all machines


class Prices(NamedTuple):
    """Prices of field work in any currency: input, lost yield and time."""

    input_ha: float = 0.0  # Cost of seed, fertiliser or product [1/ha of worked area]
    yield_ha: float = 0.0  # Value of the yield lost on missed ground [1/ha]
    hour: float = 0.0  # Cost of machine and driver [1/h]


NO_PRICES = Prices()  # Prices of zero, for which no costs are evaluated


def cost(prices: Prices, areas: Mapping[str, float], time_s: float) -> dict[str, float]:
    """Return the costs of overlaps, gaps and time, as far as their prices are known, and the sum of these costs.
    `areas` contains overlapped and missed area [m2]."""
    parts = {
        "overlap": (prices.input_ha, areas["overlapped_m2"] / 1e4),
        "missed": (prices.yield_ha, areas["missed_m2"] / 1e4),
        "time": (prices.hour, time_s / 3600),
    }
    costs = {name: price * amount for name, (price, amount) in parts.items() if price}
    return {**costs, "total": sum(costs.values())}


def effort(log: Log) -> dict[str, Any]:
    """Return energies [MJ], median slip [%] and maximum rut depth [m] of a run. Quantities that the plant does not
    provide are None.

    The energy at the wheels is the work of the driven wheels while their power is positive. The energy at the ground is
    the work of all wheel forces along the heading, against draught, slope and inertia. The difference is lost through
    slip and motion resistance.
    """
    names = log.rows.columns
    content: dict[str, Any] = {"energy_wheels_mj": None, "energy_ground_mj": None, "slip_median_percent": None}
    if all(f"slip_ratio_{wheel}" in names for wheel in DRIVEN):
        speed = log.column("speed")
        slips = np.mean([log.column(f"slip_ratio_{wheel}") for wheel in DRIVEN], axis=0)
        forces = np.sum([log.column(name) for name in names if name.startswith("fx_") and len(name) == 5], axis=0)
        rolling = speed * (1 + slips) / log.scenario.tractor.rear_wheel_radius_m
        power = np.nan_to_num(log.column("drive_torque") * rolling)
        content["energy_wheels_mj"] = float(power.clip(min=0).sum() * TICK_S / 1e6)
        content["energy_ground_mj"] = float(np.nan_to_num(forces * speed).sum() * TICK_S / 1e6)
        if (moving := slips[speed > SLOWEST_M_S]).size:
            content["slip_median_percent"] = float(100 * np.nanmedian(moving))
    content["rut_depth_max_m"] = float(log.ruts.depth.max(initial=0.0)) if log.ruts is not None else None
    return content

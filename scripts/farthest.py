"""Search of the farthest drive under a failing sensor: kind, onset, size, direction and gap, single faults and pairs.

Differential evolution [Storn1997] over the unit cube from a Latin hypercube; the cost is the largest distance from the
path. A law has 32 runs, which is a small budget: farther drives may exist.
"""

from collections.abc import Callable
from math import cos, exp, log, sin, tau
from typing import Any

import numpy as np

from agrobot_mj import load_scenario, run
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.scenario.schema import Scenario

LAWS = ("lqr", "stanley", "pure_pursuit", "nmpc")
FIRST, GENERATIONS = 16, 1
"""Runs of the hypercube, and how often as many follow."""
BASE = {
    "path.run_in_m": 0,
    "path.turns": 1,
    "duration_s": 75,
    "physics": "fast",
    "supervisor.enabled": True,
    "sensors.gyro.enabled": True,
    "sensors.wheel_speed.enabled": True,
    "sensors.imu.enabled": True,
    "sensors.gnss.dual_antenna.enabled": True,
    "estimator.kind": "ekf_full",
    "estimator.terrain_compensation": True,
}
ONSET_S, SLIDE_M_S, GAP_S = (8.0, 40.0), (0.01, 0.4), (0.1, 7.5)
"""Ranges of the onset, of the rate of a slide on a logarithmic scale, and of the gap. A jump is ten seconds of slide,
an angle 40 deg per m/s of it in ten seconds, a gyro bias 10 deg/s per m/s."""
Fault = dict[str, Any]


def drift(at: float, size: float, angle: float, gap: float, velocity: str = "drifting") -> list[Fault]:
    """A position that slides, with its velocity or without."""
    rates = {"north_m_s": size * sin(angle), "east_m_s": size * cos(angle)}
    return [{"kind": "gnss_drift", "start_s": at, "velocity": velocity, **rates}]


def loss(at: float, gap: float, period: float = 100.0) -> list[Fault]:
    """Gaps without fixes from `at` [s] on."""
    starts = np.arange(at, 75.0, max(period, gap + 0.5)).tolist()
    return [{"kind": "gnss_loss", "start_s": start, "end_s": start + gap} for start in starts]


def jump(at: float, size: float, angle: float, gap: float) -> list[Fault]:
    """A position that is off after a gap."""
    offset = {"north_m": 10 * size * sin(angle), "east_m": 10 * size * cos(angle)}
    return [{"kind": "gnss_jump", "start_s": at, **offset}, *loss(at, gap)]


def ramp(kind: str, key: str, most: float) -> Callable[..., list[Fault]]:
    """A reading whose offset grows over ten seconds to `most` per size."""
    return lambda at, size, angle, gap: [
        {"kind": kind, "start_s": at, key: most * size * (1 if angle < tau / 2 else -1), "ramp_s": 10.0}
    ]


def beside(*kinds: str) -> Callable[..., list[Fault]]:
    """A slide, and readings that are lost as long as the gap after it begins."""
    return lambda at, size, angle, gap: (
        drift(at, size, angle, gap) + [{"kind": kind, "start_s": at, "end_s": at + gap} for kind in kinds]
    )


FAMILIES: dict[str, Callable[..., list[Fault]]] = {
    "slide": drift,
    "slide of the position": lambda at, size, angle, gap: drift(at, size, angle, gap, "sound"),
    "jump in a gap": jump,
    "slide, gap": lambda at, size, angle, gap: drift(at, size, angle, gap) + loss(at, gap),
    "slide of the position, gaps": lambda *a: drift(*a, velocity="sound") + loss(a[0], min(a[3], 3.0), 5.0),
    "slide, float flicker": lambda *a: [*drift(*a), {"kind": "gnss_float", "start_s": a[0], "flicker_s": 1.0}],
    "slide, gyro loss": beside("gyro_loss"),
    "slide, wheel loss": beside("wheel_speed_loss"),
    "slide, heading loss": beside("heading_loss"),
    "roll": ramp("imu_roll_bias", "bias_deg", 200.0),
    "gyro": ramp("gyro_bias", "bias_deg_s", 20.0),
    "gyro, roll": lambda *a: ramp("gyro_bias", "bias_deg_s", 20.0)(*a) + ramp("imu_roll_bias", "bias_deg", 200.0)(*a),
}
"""Faults from onset [s], size [m/s], direction [rad] and gap [s]."""


def case(point: np.ndarray) -> tuple[str, list[Fault]]:
    """Family and faults of a point of the unit cube, shape (5,)."""
    family = list(FAMILIES)[min(int(point[0] * len(FAMILIES)), len(FAMILIES) - 1)]
    (a, b), (c, d), (e, f) = ONSET_S, SLIDE_M_S, GAP_S
    at, gap = round(a + (b - a) * point[1], 2), round(e * exp(log(f / e) * point[4]), 2)
    return family, FAMILIES[family](at, c * exp(log(d / c) * point[2]), tau * point[3], gap)


def driven(base: Scenario, point: np.ndarray) -> dict[str, Any]:
    """Row of the run with the faults of a point."""
    family, faults = case(point)
    found = run(base.changed({"fault": faults})).metrics
    safety = {f"safety.{key}": value for key, value in found["safety"].items()}
    return {
        "family": family,
        "fault": faults,
        "outcome": found["outcome"],
        "reason": found.get("stop_reason"),
        **safety,
    }


def search(law: str) -> dict[str, Any]:
    """All rows of the search under a law."""
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    base, rows = load_scenario("figure_eight", {**BASE, "guidance.kind": law}), []
    seed = 7000 + LAWS.index(law)

    def cost(points: np.ndarray) -> np.ndarray:
        some = [driven(base, point) for point in points.T]
        rows.extend(some)
        return np.array([-row["safety.offset_max"] for row in some])

    first = qmc.LatinHypercube(5, rng=seed).random(FIRST)
    differential_evolution(
        cost,
        [(0, 1)] * 5,
        init=first,
        maxiter=GENERATIONS,
        rng=seed,
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    return {"law": law, "rows": rows}


def farthest_table(searches: list[dict[str, Any]]) -> str:
    """The farthest drive of each law that was not stopped, and the farthest that was."""
    lines = []
    for found in searches:
        rows = found["rows"]
        for stopped in (False, True):
            some = [row for row in rows if (row["safety.stop_s"] is not None) == stopped]
            if not some:
                continue
            far = max(some, key=lambda row: row["safety.offset_max"])
            what = " and ".join(dict.fromkeys(map(_shown, far["fault"])))
            off, fast = (f"{far[f'safety.{key}']:.2f}" for key in ("offset_max", "overspeed"))
            reason = far["reason"] or ""
            lines.append((found["law"], len(rows), "yes" if stopped else "no", len(some), off, fast, what, reason))
    heads = (
        "law",
        "runs",
        "stopped",
        "of them",
        "off the path, largest [m]",
        "speed over command",
        "failure",
        "reason",
    )
    return markdown_table(heads, lines)


def _shown(fault: Fault) -> str:
    keys = [f"`{k} = {v:.3g}`" for k, v in fault.items() if isinstance(v, float) and k != "end_s"]
    lasts = [f"for {fault['end_s'] - fault['start_s']:.2g} s"] if fault.get("end_s") else []
    return ", ".join([f"`{fault['kind']}`", *keys, *lasts])


if __name__ == "__main__":
    import json
    import sys

    for name in sys.argv[1:] or LAWS:
        print(json.dumps(search(name)), flush=True)

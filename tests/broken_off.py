"""Interrupted studies, and studies whose runs raise errors, for tests that resume studies."""

import json
import shutil

from agrobot_mj.studies.engine import tasks

LAWS = '''
"""A law that drives on, or raises."""

from typing import Literal

from agrobot_mj.control import GuidanceLaw
from agrobot_mj.core.signals import Command


class Fragile(GuidanceLaw):
    """Raises where its level is high."""

    kind: Literal["fragile"] = "fragile"
    level: float = 0.1
    """Level [-]."""

    @property
    def tunable(self):
        return {"level": (0.1, 1.0)}

    def update(self, state, situation, dt):
        if self.level > 0.5:
            raise RuntimeError("level too high")
        return None, Command(steer=0.0, speed=1.0)
'''
BICYCLE = ("--set", "plant.kind=bicycle", "--set", "duration_s=1", "--jobs", 1, "--out", "out")
WALL = ("wall_s", "real_time_factor")


class Driven(list):
    """Record of simulated runs as pairs of seed and law. Run number `most` is interrupted."""

    most = None


def counted(monkeypatch, folder):
    """Return a list that records simulated runs. Write a guidance law that may raise errors, and tuning cases, to
    `folder`."""
    (folder / "mine.toml").write_text('seeds = 2\n[[training]]\nname = "a"\n[[test]]\nname = "b"\n')
    (folder / "laws.py").write_text(LAWS)
    real, seen = tasks.run, Driven()

    def run(scenario, *watchers, branches=None):
        if len(seen) == seen.most:
            raise KeyboardInterrupt
        seen.append((scenario.seed, scenario.law))
        return real(scenario, *watchers)

    monkeypatch.setattr(tasks, "run", run)
    return seen


def answer(folder, name):
    """Return the result of a study without its wall times, for comparisons of results."""
    found = json.loads((folder / name).read_text())
    rows = found if isinstance(found, list) else []
    return [{key: value for key, value in row.items() if key not in WALL} for row in rows] or found


def check_resuming(call, driven, tmp_path, command, name, most):
    """Check that a command interrupted in run `most` resumes with the same result as without interruption."""
    driven.most = most
    assert call(*command)[0] == 130
    assert not (tmp_path / "out" / name).exists()
    driven.most = None
    assert call(*command)[0] == 0
    resumed, total = answer(tmp_path / "out", name), len(driven)
    shutil.move(tmp_path / "out", tmp_path / "resumed")
    assert call(*command)[0] == 0
    assert len(driven) == 2 * total
    assert answer(tmp_path / "out", name) == resumed
    assert call(*command)[0] == 0
    assert len(driven) == 2 * total  # no run is repeated

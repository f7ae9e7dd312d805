"""The riding tractor and its twin: what the logs say, and what the models make of it, each found only once."""

from functools import cached_property
from pathlib import Path

import numpy as np

from agrobot_mj import load_scenario
from agrobot_mj.extensions.logs.calibrate import Calibration
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.residuals import Replayed, metrics
from agrobot_mj.scenario import Scenario
from agrobot_mj.terrain.rough import ROUGHNESS
from riding_tractor.closed_loop import Loop, Pass, recorded, terrain
from riding_tractor.logs import CALIBRATION, HELD_OUT, Repository, pursuit_log
from riding_tractor.prediction import (
    BICYCLE,
    CARCASS,
    MACHINE,
    NO_SLIP,
    Model,
    Motor,
    Numbers,
    calibration,
    explained,
    motor,
    recordings,
    replayed,
    twin,
)

SEEDS = range(1, 5)
"""Seeds of the closed loop, each with ground of its own."""
ROUGHEST, FINEST = 16.0 * ROUGHNESS["C"], ROUGHNESS["C"] / 16
"""Bounds of the roughness that is fitted [m3]."""
SLOW, FAST = 0.5, 0.85
"""Speeds of the missions: roughness is fitted at the first and tested at the second [m/s]."""


class Comparison:
    """The logs, and what is found in them; each only once."""

    def __init__(self, logs: Repository, bus: Repository | None, images: Path, work: Path) -> None:
        """Logs of the riding tractor and of the bus, if there are any, and folders for figures and for ground."""
        self.logs, self.bus, self.images, self.work = logs, bus, images, work
        self._ways: dict[tuple[str, Model], list[Replayed]] = {}

    @cached_property
    def motor(self) -> Motor:
        """The steering motor, by the scale of the calibration."""
        return motor(self.logs, self.scale)

    @cached_property
    def calibration(self) -> Calibration:
        """The sensors, by the runs of the calibration."""
        return calibration(self.logs, machine())

    @cached_property
    def pieces(self) -> dict[str, list[FieldRecording]]:
        """Pieces of all runs by their names."""
        log_map = self.calibration.calibrated
        return {run.name: recordings(self.logs, run, log_map, machine()) for run in (*CALIBRATION, *HELD_OUT)}

    @cached_property
    def carcass(self) -> float:
        """Stiffness of the twin's carcass: the one that tells the runs of the calibration best."""
        return max(CARCASS, key=lambda share: sum(explained(self.told(run.name, share)) for run in CALIBRATION))

    def ways(self, run: str, model: Model) -> list[Replayed]:
        """The pieces of a run, driven by a model."""
        if (run, model) not in self._ways:
            plant = None
            if model == BICYCLE:
                plant = self.twin.changed({"plant.kind": "bicycle"})
            elif isinstance(model, float):
                plant = self.twin.changed({"plant.tyre.carcass_lateral": model})
            self._ways[run, model] = replayed(self.pieces[run], plant, self.wheelbase)
        return self._ways[run, model]

    def told(self, run: str, model: Model) -> Numbers:
        """How well a model tells a run."""
        return metrics(self.ways(run, model), self.wheelbase)

    @property
    def wheelbase(self) -> float:
        """Wheelbase of the machine [m]."""
        return machine().tractor.wheelbase_m

    @property
    def models(self) -> dict[str, Model]:
        """What predicts, by name."""
        usual: float = self.twin.plant.tyre.carcass_lateral
        return {
            "MuJoCo, default tyres": usual,
            "MuJoCo, the twin's tyres": self.carcass,
            "bicycle": BICYCLE,
            "wheels without slip": NO_SLIP,
        }

    @property
    def loop(self) -> Loop:
        """The twin under the owner's guidance."""
        twin = self.twin.changed({"plant.tyre.carcass_lateral": self.carcass})
        return Loop(twin, self.centre, self.scale, heading_error=self.heading_error)

    @cached_property
    def passes(self) -> dict[str, Pass]:
        """Recorded passes by run."""
        return {run.name: recorded(pursuit_log(self.logs, run)) for run in (*CALIBRATION, *HELD_OUT)}

    def driven(self, loop: Loop, speed: float, roughness: float) -> list[Pass]:
        """Passes of a twin over ground of a roughness [m3], one for each seed."""
        return [loop.run(speed, seed, terrain(self.work, seed, roughness)).middle for seed in SEEDS]

    @cached_property
    def roughness(self) -> dict[float, list[Pass]]:
        """Passes at the lower speed by roughness [m3]."""
        steps = np.geomspace(FINEST, ROUGHEST, 5).tolist()
        return {step: self.driven(self.loop, SLOW, step) for step in steps}

    @cached_property
    def fitted(self) -> float:
        """Roughness whose mean distance at the lower speed is nearest to the recorded one [m3]."""
        wanted = np.mean([p.mean for name, p in self.passes.items() if not name.endswith("85")])
        return min(self.roughness, key=lambda step: abs(np.mean([p.mean for p in self.roughness[step]]) - wanted))

    @property
    def scale(self) -> float:
        """Steering angle per count [deg]."""
        return self.calibration.found["steer.scale"].value

    @property
    def centre(self) -> float:
        """Reading straight ahead [counts]."""
        return self.calibration.found["steer.offset"].value

    @property
    def heading_error(self) -> float:
        """Constant error of the heading, left positive [deg]."""
        return -self.calibration.found["heading.offset"].value

    @cached_property
    def twin(self) -> Scenario:
        """The machine with the motor and the receivers of the logs."""
        return twin(self.motor)


def machine() -> Scenario:
    """The machine as it comes with the package, on a straight line."""
    return load_scenario("straight_line", {"machine": MACHINE})

"""Evaluation of a run: its outcome, its log and its metrics. During a run, the metrics sample the path separately, so
that the path samples of the guidance law do not change."""

from dataclasses import replace

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics import RunView, metrics
from agrobot_mj.metrics.progress import PathProgress, commanded_progress, progress_of
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.diagnosis import diagnosis
from agrobot_mj.simulation.interpreted import interpreted_stages
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.loop import Loop


class Evaluation:
    """Evaluation of a run, whose log is stored in `rows`."""

    def __init__(self, scenario: Scenario, loop: Loop, rows: Rows) -> None:
        self.scenario, self.loop, self.rows = scenario, loop, rows
        self.progress: PathProgress | None = None  # Progress on the path at the end of the run, if already computed

    def ending(self) -> tuple[str, str]:
        """Return the outcome of a run at its planned end, and the reason if the run is unfinished.

        The outcome is `completed` if enough of the path or of the commanded distance was driven, else `unfinished`.
        """
        column = self.rows.column
        if self.loop.guidance.follows_path:
            places = [column(name) for name in ("t", "x", "y")]
            self.progress = found = progress_of(self.loop.route, self.scenario.duration_s, places)
        else:
            found = commanded_progress(column("t"), column("speed_ref"), column("speed"))
        if found.enough:
            return "completed", ""
        return "unfinished", f"drove {found.driven:.1f} of {found.length:.1f} m"

    def log(self, outcome: str, reason: str, wall_s: float, identity: str) -> Log:
        """Return the log of the run so far, with metrics; `wall_s` is the wall time of the run [s].

        `outcome` is empty during a run, whose log then has the outcome `aborted`.
        """
        plant, learned = self.loop.plant, self.loop.learned()
        log = Log(self.scenario, self.rows, plant.scene, outcome or "aborted", wall_s, {}, plant.ruts(), learned)
        view = RunView(log, self.loop.route if outcome else SampledRoute(self.scenario.path))
        if self.progress:
            view.progress = self.progress
        found, rejected = metrics(log, view=view), dict(self.loop.stages.sensors.rejected)
        numbers = {
            "outcome": log.outcome,
            **({"stop_reason": reason} if reason else {}),
            **({"rejected_readings": rejected} if rejected else {}),
            **found,
            **diagnosis(log, view, found),
            "physics_warnings": plant.warnings(),
            **({"interpreted_stages": ", ".join(stages)} if (stages := interpreted_stages(self.loop)) else {}),
            "real_time_factor": self.rows.filled * TICK_S / max(wall_s, 1e-9),
            "wall_s": wall_s,
            "identity": identity,
        }
        return replace(log, metrics=numbers, view=view)

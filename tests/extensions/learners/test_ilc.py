"""Iterative learning: update of the correction map from lap to lap compared with theory, its guards, and its law."""

from math import exp, inf, log, pi, radians, sin

import numpy as np
import pytest
from drives import Bend, drive

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.control import Lqr
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.learned import LEARNED, read_learned
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.learners.ilc import SETTLED_M, Ilc
from agrobot_mj.extensions.learners.implement_ilc import ImplementIlc
from agrobot_mj.extensions.learners.lap_map import GIVE_UP, LapMap, LapState
from agrobot_mj.metrics import RunView
from agrobot_mj.paths import Circle, FigureEight, Line, Swaths
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.hints import hints
from agrobot_mj.simulation.storage import write_log

LAP, STEP, BOUND = 40.0, 0.0625, 1.0
PER_LAP = round(LAP / STEP)
WAVES = 4
MOST = 0.1


def disturbance(s: float) -> float:
    return MOST * sin(2 * pi * WAVES * s / LAP)


def laps(map_: LapMap, count: float, error=lambda lap, rest: rest, state: LapState | None = None, begin: float = 0.0):
    """Simulate laps in which the feedback corrects the residual disturbance. Return the state and the residuals."""
    state = map_.begin(begin, LAP) if state is None else state
    rests = []
    for s in np.arange(begin, begin + count * LAP, STEP):
        rest = disturbance(s) - map_.value(state, s, LAP)
        state = map_.after(state, s, LAP, error(s / LAP, rest), rest, BOUND)
        rests.append(rest)
    return state, np.array(rests)


@pytest.mark.parametrize("smoothing", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("gain", [0.3, 0.5, 1.0])
def test_residual_error_decreases_from_lap_to_lap_as_predicted(gain: float, smoothing: float) -> None:
    """The error decreases by the factor 1 - gain H, where H is the response of the filter at the wavelength."""
    sigma = smoothing / (2 * (2 * log(2)) ** 0.5)
    H = exp(-2 * (pi * sigma * WAVES / LAP) ** 2)
    rests = laps(LapMap(gain=gain, smoothing_m=smoothing), 4)[1][: 4 * PER_LAP].reshape(4, -1)[
        :, 60:-60
    ]  # one map fades into the next at either end
    left = np.abs(rests).max(axis=1) / MOST
    assert left == pytest.approx([(1 - gain * H) ** k for k in range(4)], abs=0.02)


def test_filter_of_the_correction_map_has_zero_phase() -> None:
    state, _ = laps(LapMap(gain=0.5), 3)
    places = LAP * (np.arange(len(state.map_)) + 0.5) / len(state.map_)
    spectrum = np.fft.rfft(state.map_)[WAVES]
    assert np.angle(spectrum * np.conj(np.fft.rfft([disturbance(s) for s in places])[WAVES])) == pytest.approx(
        0, abs=0.02
    )


def test_correction_map_decays_after_the_disturbance_disappears() -> None:
    map_ = LapMap(guard=False)
    state = laps(map_, 3.01)[0]
    before = np.abs(state.map_).max()
    for s in np.arange(3.01 * LAP, 5.01 * LAP, STEP):
        state = map_.after(state, s, LAP, 0.0, -map_.value(state, s, LAP), BOUND)
    assert np.abs(state.map_).max() < 0.4 * before


@pytest.mark.parametrize(("share", "most"), [(1.0, 0.05), (0.5, 0.95), (0.0, 1.02)])
def test_correction_map_learns_only_corrections_that_repeat_every_lap(share: float, most: float) -> None:
    """A fraction `share` of the power repeats in every lap; the other part is random and is not learned."""
    draw, map_ = np.random.default_rng(4), LapMap(guard=False)
    turn = np.arange(0.0, 1.0, STEP / LAP)

    def pattern() -> np.ndarray:
        waves = 2 * pi * np.outer(np.arange(1, 7), turn) + draw.uniform(0, 2 * pi, (6, 1))
        return draw.normal(size=6) @ np.sin(waves)

    same, state, left = pattern(), map_.begin(0.0, LAP), []
    for lap in range(24):
        wanted = 0.1 * (share**0.5 * same + (1 - share) ** 0.5 * pattern())
        rest = np.empty(PER_LAP)
        for k, s in enumerate(LAP * (lap + turn)):
            rest[k] = wanted[k] - map_.value(state, s, LAP)
            state = map_.after(state, s, LAP, 0.0, rest[k], BOUND)
        left.append((rest @ rest, wanted @ wanted))
    after = np.sum(left[4:], axis=0)
    assert after[0] < most**2 * after[1]


def test_correction_map_stays_within_its_bound() -> None:
    map_ = LapMap(gain=1.0, guard=False)
    state = map_.begin(0.0, LAP)
    for s in np.arange(0.0, 5 * LAP, STEP):
        state = map_.after(state, s, LAP, 0.0, 0.4, 0.3)
    assert state.map_.max() == pytest.approx(0.3)


def test_worse_correction_map_is_replaced_by_the_best_map_during_a_lap() -> None:
    """From the third lap on, the error is ten times the error of the second lap, which was the best."""

    def error(lap: float, rest: float) -> float:
        return 0.05 if lap < 1 else 0.03 if lap < 2 else 0.3

    state, _ = laps(LapMap(), 2.0, error)
    best = state.map_.copy()
    state, _ = laps(LapMap(), 0.2, error, state, 2.0 * LAP)
    assert state.returns == 1, "within a fifth of the lap"
    assert np.array_equal(state.map_, best)
    assert not state.learning
    assert state.best_rms == inf, "how good it is now is to be seen"
    later, _ = laps(LapMap(), 0.9, error, state, 2.2 * LAP)
    assert np.array_equal(later.map_, best)
    assert later.learning, "a new lap"


def test_lap_with_a_larger_error_does_not_change_the_correction_map() -> None:
    state, _ = laps(LapMap(), 3.0, lambda lap, rest: 0.05 if lap < 2 else 0.09)
    kept = state.best.copy()
    state, _ = laps(LapMap(), 0.1, lambda lap, rest: 0.05, state, 3.0 * LAP)
    assert state.returns == 1
    assert np.array_equal(state.map_, kept)
    assert state.share == 0.5


def test_learning_stops_after_several_returns_to_the_best_map() -> None:
    state, _ = laps(LapMap(), 25.0, lambda lap, rest: 0.05 + 0.2 * (int(lap) % 2))
    assert state.returns == GIVE_UP
    assert not state.learning


def test_learning_without_a_guard_continues_despite_growing_errors() -> None:
    state, _ = laps(LapMap(guard=False), 4.0, lambda lap, rest: 0.05 * 4**lap)
    assert state.returns == 0
    assert np.abs(state.map_).max() > 0.05


def test_incomplete_lap_does_not_change_the_correction_map() -> None:
    state, _ = laps(LapMap(), 0.5, begin=0.5 * LAP)
    state, _ = laps(LapMap(), 0.1, state=state, begin=LAP)
    assert not state.map_.any()
    assert state.learning


@pytest.mark.parametrize(
    ("path", "lap"),
    [
        (Circle(radius_m=8.0, turns=2), 2 * pi * 8.0),
        (Circle(radius_m=500.0, turns=2), 2 * pi * 500.0),
        (Line(length_m=80.0), 80.0),
        (FigureEight(turns=3), FigureEight().turn_s * 1.2),
        (FigureEight(turns=1, run_in_m=0.0), FigureEight().turn_s * 1.2),
    ],
    ids=["circle", "wide circle", "line", "figure eight", "one turn"],
)
def test_lap_ends_where_the_heading_repeats(path, lap: float) -> None:
    assert SampledRoute(path).lap() == pytest.approx(lap, abs=0.16)


def test_two_field_passes_in_opposite_directions_form_one_lap() -> None:
    path = Swaths(length_m=30.0, swath_m=3.0, count=6, run_in_m=5.0)
    lap, route = SampledRoute(path).lap(), SampledRoute(path)
    assert lap == pytest.approx(2 * (30.0 + (path.passes_s[1][1] - path.passes_s[0][1] - 30 / 1.2)), abs=8.0)
    here, there = route.ahead(5.0), route.ahead(5.0 + lap)
    assert there.yaw == pytest.approx(here.yaw, abs=1e-6)
    assert abs(there.x - here.x) + abs(there.y - here.y) == pytest.approx(6.0, abs=0.1)


def test_law_with_an_empty_correction_map_equals_its_inner_law() -> None:
    alone, inside = drive(Lqr(), Bend(1.2, 0.1), 10.0), drive(Ilc(inner=Lqr()), Bend(1.2, 0.1), 10.0)
    assert np.array_equal(alone.offset, inside.offset)
    assert alone.commands == inside.commands
    learns = [row[[column.name for column in Ilc().columns].index("learning")] for row in inside.reports]
    first = learns.index(1.0) * TICK_S * 1.2
    assert first == pytest.approx(SETTLED_M, abs=1.0), "the way onto the path is not learnt from"


@pytest.mark.parametrize(
    "law",
    [
        pytest.param(Ilc(inner=Lqr(integral_m_s=None)), id="without integral", marks=pytest.mark.slow),
        pytest.param(Ilc(), id="LQR"),
    ],
)
def test_correction_map_learns_to_compensate_for_a_steering_bias(law: Ilc) -> None:
    d = drive(law, FigureEight(radius_m=6.0, straight_m=12.0, run_in_m=6.0, turns=6), 380.0, bias=radians(2.0))
    names = [column.name for column in law.columns]
    learned, feedback = (
        np.array([row[names.index(key)] for row in d.reports]) for key in ("steer_learned", "steer_feedback")
    )
    rms = [float(np.sqrt(np.mean(d.offset[k : k + 1250] ** 2))) for k in (0, 6000)]
    assert np.degrees(learned[-1250:].mean()) == pytest.approx(2.0, abs=0.4)
    assert abs(np.degrees(feedback[-1250:].mean())) < 0.4
    assert rms[1] < 0.7 * rms[0]


WORN = {"kind": "valve_wear", "gain_share": 0.5, "dead_band_v": 0.6}
EIGHT = {
    **{f"path.{key}": value for key, value in {"radius_m": 6.5, "straight_m": 12, "run_in_m": 6, "turns": 4}.items()},
    "path.transition": "clothoid",
    "plant.kind": "bicycle",
    "estimator.kind": "ekf_full",
    **{f"sensors.{name}.enabled": True for name in ("gyro", "wheel_speed", "imu")},
    "guidance.kind": "ilc",
    "fault": [WORN],
}


def test_values_learned_in_a_run_can_initialise_the_next_run(tmp_path) -> None:
    keys = {**EIGHT, "path.turns": 1, "path.run_in_m": 0, "steering.loop.kind": "adaptive"}
    log = run(load_scenario("figure_eight", keys))
    write_log(log, tmp_path / "first")
    file = str(tmp_path / "first" / LEARNED)
    known = read_learned(file)
    assert {"steer_learned", "valve_gain_left", "valve_dead_band_right"} <= set(known)
    sim = Simulation("figure_eight", {**keys, "guidance.file": file, "steering.loop.file": file})
    sim.reset()
    sim.step()
    names, row = sim.rows.columns, sim.rows.values[0]
    assert row[names.index("valve_dead_band_left")] == pytest.approx(known["valve_dead_band_left"][0, 1], rel=1e-6)
    state = sim.loop.stages.guidance.lap
    assert state.map_ == pytest.approx(known["steer_learned"][:, 1])
    assert state.best_rms == pytest.approx(float(np.sqrt(np.mean(known["steer_learned_best_error"][:, 1] ** 2))))
    write_log(run(sim.scenario.changed({"duration_s": 1.0})), tmp_path / "second")
    assert (tmp_path / "second" / f"{LEARNED[:-8]}-2.parquet").read_bytes() == (
        tmp_path / "first" / LEARNED
    ).read_bytes()
    assert hints(load_scenario(tmp_path / "second" / "scenario.toml")) == []
    (hint,) = hints(load_scenario("figure_eight", {**keys, "guidance.file": file, "path.radius_m": 8}))
    lap = SampledRoute(sim.scenario.path).lap()
    assert hint.startswith(
        f"guidance.file: the file was learned on a lap of {lap:.4g} m, but the lap of this path is 104.5 m"
    )


@pytest.mark.parametrize("law", ["ilc", "implement_ilc"])
def test_initial_file_without_a_correction_map_is_rejected(law: str, tmp_path) -> None:
    with pytest.raises(ScenarioError, match=r"guidance.file: none.parquet: no such file"):
        load_scenario("circle", {"guidance.kind": law, "guidance.file": str(tmp_path / "none.parquet")})
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "steering.loop.kind": "adaptive", "duration_s": 0.1}))
    write_log(log, tmp_path)
    with pytest.raises(
        ScenarioError, match=r"guidance.file: learned.parquet: the file has no \w+_learned, only valve_gain"
    ):
        load_scenario("circle", {"guidance.kind": law, "guidance.file": str(tmp_path / LEARNED)})
    with pytest.raises(ScenarioError, match=r"signals.parquet: the file has no columns quantity"):
        load_scenario("circle", {"guidance.kind": law, "guidance.file": str(tmp_path / "signals.parquet")})


def test_receiver_on_an_implement_is_rejected_without_an_implement() -> None:
    with pytest.raises(ScenarioError, match=r"sensors.implement_gnss: the scenario has no implement"):
        load_scenario("circle", {"sensors.implement_gnss.enabled": True})


@pytest.mark.slow
@pytest.mark.parametrize("smoothing", [1.0, 0.6])
@pytest.mark.parametrize("loop", ["pid", "adaptive"])
def test_errors_with_unstable_learning_settings_stay_below_30_cm(smoothing: float, loop: str) -> None:
    keys = {
        "guidance.map.gain": 0.7,
        "guidance.map.smoothing_m": smoothing,
        "steering.loop.kind": loop,
        "path.turns": 6,
    }
    log = run(load_scenario("figure_eight", {**EIGHT, **keys}))
    assert log.outcome == "completed"
    assert np.abs(RunView(log).cg_on_path.offset).max() < 0.3


def test_learned_tractor_line_reduces_the_offset_of_the_trailer() -> None:
    """Without slip a trailer of 2 m cuts bends of 6.5 m by 0.3 m; the offset is estimated from its angle."""
    law = ImplementIlc(inner=Lqr())
    names = [column.name for column in law.columns]
    d = drive(law, FigureEight(radius_m=6.5, straight_m=12.0, run_in_m=6.0, transition="clothoid", turns=5), 330.0)
    offset = np.array([row[names.index("implement_offset_hat")] for row in d.reports])
    assert np.sqrt(np.mean(offset[-1250:] ** 2)) < 0.4 * np.sqrt(np.mean(offset[200:1250] ** 2))
    assert np.abs(d.offset[-1250:]).max() > 0.15, "the tractor swings out"

"""Plugins with invalid return values: the error names the kind and the expected type."""

from math import inf, nan
from typing import Literal

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.control.base import YawCommand, YawController
from agrobot_mj.core.contracts import check_pair, check_update
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Column, Estimate
from agrobot_mj.estimation.base import StateEstimator
from agrobot_mj.faults.base import Scripted
from agrobot_mj.machine import TractorParameters
from agrobot_mj.paths import Line
from agrobot_mj.scenario.checks import check_files
from agrobot_mj.scenario.plugins import register
from agrobot_mj.sensors.base import Sensor
from agrobot_mj.sensors.gyro import Gyro
from agrobot_mj.terrain.base import Landscape
from agrobot_mj.terrain.grid import plane
from agrobot_mj.tyres.base import TyreBase
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.linear import Linear


def scenario(**parts):
    """Return a run of half a second on the bicycle with replaced components."""
    return load_scenario("straight_line", {"plant.kind": "bicycle", "duration_s": 0.5}).model_copy(update=parts)


class Blunt(StateEstimator):
    kind: Literal["blunt"] = "blunt"

    def init(self, x, y, yaw, tractor):
        return None

    def update(self, state, measurement, dt):
        return state


class Vague(Blunt):
    kind: Literal["vague"] = "vague"

    def update(self, state, measurement, dt):
        return state, Estimate(*[0.0] * len(Estimate._fields))


class Wordy(Line):
    kind: Literal["wordy"] = "wordy"

    def at(self, t):
        return super().at(t) if t < 0.2 else super().at(t)._replace(x="east")


class Broken(Scripted):
    kind: Literal["broken"] = "broken"
    answer: str = "none"

    def apply(self, state, conditions, t, dt):
        answers = {"none": None, "number": (state, 3), "nan": (state, conditions._replace(gnss_offset=(0.0, nan)))}
        return answers[self.answer]


class Silent(Gyro):
    def measure(self, state, truth, conditions, dt):
        return 0.1


class Lost(Line):
    kind: Literal["lost"] = "lost"
    bend: float = 0.0
    lasts: float = 5.0
    turns: tuple[tuple[float, ...], ...] | None = ((0.0, 5.0),)

    @property
    def turns_s(self):
        return self.turns

    @property
    def max_curvature(self):
        return self.bend

    @property
    def duration_s(self):
        return self.lasts

    def at(self, t):
        return super().at(t) if t < 0.1 else (0.0, 0.0)


class Spoilt(Line):
    kind: Literal["spoilt"] = "spoilt"
    field: str = "vx"
    value: float = 0.0
    from_s: float = 0.0

    def at(self, t):
        found = super().at(t)
        return found._replace(**{self.field: self.value}) if t >= self.from_s else found


class Hole(Landscape):
    kind: Literal["hole"] = "hole"
    answer: str = "none"

    def relief(self):
        flat = plane(0.0, 0.0, 10.0, 10.0)
        heights = {"nan": np.full_like(flat.heights, nan), "row": np.zeros(4), "one": np.zeros((1, 4))}
        return None if self.answer == "none" else flat._replace(heights=heights[self.answer])


class OneSided(Linear):
    kind: Literal["one_sided"] = "one_sided"

    def coefficients(self, tractor):
        return super().coefficients(tractor)[:1]


def test_estimator_that_does_not_return_state_and_estimate_is_rejected():
    with pytest.raises(ScenarioError, match=r"the estimator \(blunt\): update must return its state and an Estimate"):
        run(scenario(estimator=Blunt()))


@pytest.mark.parametrize("answer", ["none", "number"])
def test_fault_that_does_not_return_state_and_conditions_is_rejected(answer):
    with pytest.raises(ScenarioError, match=r"fault\[0\] \(broken\): apply must return its state and a Conditions"):
        run(scenario(fault=(Broken(start_s=0.2, answer=answer),)))


@pytest.mark.parametrize("start", [0.0, 0.2])
@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_error_names_non_numeric_fault_conditions(start, plant):
    whole = load_scenario("straight_line", {"plant.kind": plant, "duration_s": 0.5})
    log = run(whole.model_copy(update={"fault": (Broken(start_s=start, answer="nan"),)}))
    assert log.outcome == "diverged"
    assert log.metrics["stop_reason"] == "conditions.gnss_offset is nan, returned by a fault (broken)"


def test_sensor_that_does_not_return_state_and_reading_is_rejected():
    whole = scenario()
    blind = whole.sensors.model_copy(update={"gyro": Silent()})
    with pytest.raises(
        ScenarioError,
        match=r"the sensor \(gyro\): measure must return its state and measurement",
    ):
        run(whole.model_copy(update={"sensors": blind}))


class Chatty(Gyro):
    answer: str = "short"

    @property
    def columns(self):
        return Column("louder", "rad/s", "rate"), Column("quieter", "rad/s", "rate")

    def report(self, reading):
        return {"short": (1.0,), "long": (1.0, 2.0, 3.0), "text": ("a", 2.0), "none": None, "complex": (1j, 2.0)}[
            self.answer
        ]


@pytest.mark.parametrize("answer", ["short", "long", "text", "none", "complex"])
def test_component_report_without_a_number_per_column_is_rejected(answer):
    whole = scenario()
    loud = whole.sensors.model_copy(update={"gyro": Chatty(answer=answer)})
    with pytest.raises(
        ScenarioError, match=r"the sensor \(gyro\): the method report\(\) must return 2 numbers, one per col"
    ):
        run(whole.model_copy(update={"sensors": loud}))


def test_estimate_with_non_numeric_values_is_rejected():
    with pytest.raises(ScenarioError, match=r"the estimator \(vague\) returned a non-numeric estimate: Estimate\("):
        run(scenario(estimator=Vague()))


@pytest.mark.parametrize("given", [np.eye(5)[:3, :3], np.eye(3, dtype=int), np.eye(3)[::-1, ::-1]])
def test_covariance_of_an_estimate_may_be_a_view_of_a_larger_array(given):
    class Sure(Blunt):
        def update(self, state, measurement, dt):
            place = (measurement.fix.x, measurement.fix.y) if measurement.fix else (0.0, 0.0)
            return state, Estimate(*place, 0.0, 1.0, 0.0, *place, given)

    assert np.array_equal(run(scenario(estimator=Sure())).column("p_yy"), np.ones(10))


def test_covariance_of_a_wrong_shape_is_rejected():
    class Flat(Blunt):
        def update(self, state, measurement, dt):
            return state, Estimate(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, np.eye(2))

    with pytest.raises(ScenarioError, match=r"estimate.covariance must have the shape \(3, 3\), got \(2, 2\)"):
        run(scenario(estimator=Flat()))


def test_reference_with_non_numeric_values_is_rejected():
    with pytest.raises(
        ScenarioError, match=r"the path \(wordy\) returned a non-numeric reference: Reference\(x='east'"
    ):
        run(scenario(path=Wordy()))


def test_path_that_does_not_return_references_is_rejected():
    with pytest.raises(ScenarioError, match=r"the path \(lost\): at must return a Reference, got \(0.0, 0.0\)"):
        run(scenario(path=Lost()))


@pytest.mark.parametrize("number", [nan, inf, -1.0, None, "long"])
@pytest.mark.parametrize("name", ["max_curvature", "duration_s"])
def test_path_with_non_numeric_properties_is_rejected(name, number):
    key = {"max_curvature": "bend", "duration_s": "lasts"}[name]
    with pytest.raises(ScenarioError, match=f"path: {name} of kind 'lost' must be finite and not negative"):
        check_files(scenario(path=Lost().model_copy(update={key: number})), "mine.toml")


@pytest.mark.parametrize("turns", [(), ((0.0, nan),), ((0.0, inf),), ((-1.0, 2.0),), ((3.0, 2.0),), ((1.0,),), None])
def test_path_whose_laps_are_not_pairs_of_finite_times_is_rejected(turns):
    lost = Lost().model_copy(update={"turns": turns})
    with pytest.raises(ScenarioError, match="path: turns_s of kind 'lost' must have at least one pair"):
        check_files(scenario(path=lost), "mine.toml")


@pytest.mark.parametrize("from_s", [0.0, 0.3])
@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("field", ["x", "y", "vx", "vy", "yaw", "curvature", "curvature_rate"])
def test_non_finite_references_are_rejected_before_the_run(field, value, from_s):
    spoilt = Spoilt().model_copy(update={"field": field, "value": value, "from_s": from_s})
    message = rf"the path \(spoilt\) at t = 0.[03]\d s: reference.{field} is {value}"
    with pytest.raises(ScenarioError, match=message):
        run(scenario(path=spoilt))


@pytest.mark.parametrize("answer", ["none", "nan", "row", "one"])
def test_terrain_that_does_not_return_a_height_grid_is_rejected(answer):
    wanted = "relief must return a Ground" if answer == "none" else "relief: the heights must be finite numbers"
    with pytest.raises(ValueError, match=wanted):
        Hole(answer=answer).ground()


def test_tyre_that_does_not_return_laws_of_both_axles_is_rejected():
    with pytest.raises(ScenarioError, match=r"the tyre \(one_sided\): coefficients must return the law of a front and"):
        tyre_set(OneSided(), TractorParameters())


def test_plugin_without_its_abstract_methods_is_rejected():
    class Unfinished(TyreBase):
        kind: Literal["unfinished"] = "unfinished"

    with pytest.raises(
        ScenarioError, match="register: Unfinished: the class lacks coefficients, structure, required by its base"
    ):
        register(Unfinished)

    class Deaf(Sensor):
        pass

    with pytest.raises(ScenarioError, match=r"register: Deaf: .*lacks .*measure"):
        register(Deaf)


class Quitting(Hole):
    kind: Literal["quitting"] = "quitting"

    def relief(self):
        raise SystemExit(3)


class Resigning(Blunt):
    kind: Literal["resigning"] = "resigning"

    def init(self, x, y, yaw, tractor):
        raise SystemExit(0)


def test_plugin_that_calls_sys_exit_gives_an_error_message():
    for begin in (
        lambda: check_files(scenario(terrain=Quitting()), "mine.toml"),
        lambda: run(scenario(estimator=Resigning())),
    ):
        with pytest.raises(ScenarioError, match=r"code of a plugin ended the run with SystemExit"):
            begin()


def test_invalid_return_values_are_shortened_in_the_message():
    with pytest.raises(ScenarioError) as refused:
        check_update([0] * 10_000, int, "the law", "mine", "update")
    assert str(refused.value).startswith("the law (mine): update must return its state and an int, got [0, 0")
    assert len(str(refused.value)) < 300
    with pytest.raises(ScenarioError, match="got 'two lines'"):
        check_pair("two lines", "a pair", "the law", "mine", "update")


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (None, "update must return its state and a YawCommand, got None"),
        ((0, 0.1), "update must return its state and a YawCommand, got"),
        ((0, YawCommand(None)), r"returned a non-numeric command: YawCommand\(steer=None"),
        ((0, YawCommand(0.0, q=None)), r"returned a non-numeric command: YawCommand\(steer=0.0"),
        ((0, YawCommand(10**400)), "returned a non-numeric command"),
    ],
)
def test_invalid_return_value_of_a_yaw_controller_is_rejected(answer, text):
    class Vain(YawController):
        kind: Literal["vain"] = "vain"

        def init(self):
            return 0

        def update(self, state, t, yaw_rate_error, dt, steer_limit):
            return answer

    with pytest.raises(ScenarioError, match=rf"the controller \(vain\)\S* {text}"):
        run(scenario(controller=Vain()))

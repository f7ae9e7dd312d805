"""Requirements on every fault: time window, randomness, overlaps, and definition in a file."""

from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from scripted import scripted

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import NOMINAL, TICK_S, Distortion, Quality
from agrobot_mj.core.spec import members
from agrobot_mj.faults import Fault
from agrobot_mj.scenario.schema import resolve
from agrobot_mj.sensors import DualAntenna, Gnss, Sensors
from agrobot_mj.simulation.loop import Loop

KINDS = sorted(members(Fault))
SENSED = [kind for kind in KINDS if not members(Fault)[kind].machine]


def faults(*tables):
    """Return the faults of a scenario with the given fault tables."""
    return resolve({"fault": list(tables)}, "test").fault


def conditions(*tables, seed=1, seconds=60.0):
    return scripted(faults(*tables), round(seconds / TICK_S), seed)


def refused(*tables, **overrides):
    with pytest.raises(ScenarioError) as error:
        resolve({"fault": list(tables), **overrides}, "mine.toml")
    return str(error.value)


# --- every kind ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_every_fault_acts_only_within_its_time_window(kind):
    days = conditions({"kind": kind, "start_s": 20, "end_s": 40})
    changed = [k for k, day in enumerate(days) if day != NOMINAL]
    assert changed
    assert min(changed) == 400, "at once"
    assert max(changed) < 800


def test_bias_fault_grows_linearly_over_its_ramp_and_then_stays():
    table = {"kind": "steering_pot_bias", "bias_deg": 4.0, "ramp_s": 10, "start_s": 20}
    grown = [day.steering_pot.offset for day in conditions(table)]
    assert [grown[k] for k in (399, 400, 500, 600, 1199)] == pytest.approx(np.radians([0.0, 0.0, 2.0, 4.0, 4.0]))


@pytest.mark.parametrize("kind", KINDS)
def test_random_fault_effects_depend_only_on_the_seed(kind):
    table = {"kind": kind, "start_s": 5}
    assert conditions(table) == conditions(table)
    others = ({"kind": other, "start_s": 70} for other in KINDS if other != kind)
    assert conditions(*others, table) == conditions(table), "whatever else is in the file"


@pytest.mark.parametrize("kind", KINDS)
def test_every_fault_is_unchanged_by_writing_and_reading_toml(kind, tmp_path):
    scenario = resolve({"fault": [{"kind": kind, "start_s": 1.5}, {"kind": kind, "start_s": 0, "end_s": 1.5}]}, "two")
    (tmp_path / "two.toml").write_text(scenario.to_toml())
    again = load_scenario(tmp_path / "two.toml")
    assert again.fault == scenario.fault
    assert again.hash8 == scenario.hash8
    assert "[[fault]]" in scenario.to_toml() or "fault = [" in scenario.to_toml()


def test_scenario_hash_depends_on_the_faults():
    hashes = {
        resolve({"fault": tables}, "h").hash8 for tables in ([], [{"kind": "gnss_loss"}], [{"kind": "gnss_float"}])
    }
    assert len(hashes) == 3


def test_fault_windows_are_independent_of_clock_rounding():
    """In floating point, 0.05 s times 3 is above 0.15, and the sum of eight ticks is below 0.4."""
    (fault,) = faults({"kind": "gnss_loss", "start_s": 0.15, "end_s": 0.4})
    for clock in (0.05 * np.arange(10), 25 * 0.002 * np.arange(10), np.cumsum([0.0] + 9 * [0.05])):
        assert [fault.active(t) for t in clock] == [3 <= k < 8 for k in range(10)]


def test_log_contains_the_number_of_active_faults():
    tables = [{"kind": "gnss_loss", "start_s": 1, "end_s": 2}, {"kind": "valve_wear", "start_s": 1.5}]
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "duration_s": 3, "fault": tables}))
    t, active = log.column("t"), log.column("faults_active")
    wanted = ((t > 0.99) & (t < 1.99)).astype(float) + (t > 1.49)
    assert active == pytest.approx(wanted)
    assert log.rows.columns.index("faults_active") == log.rows.columns.index("gnss_quality") + 1


# --- randomness ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drive():
    """Return the true states of a run without faults, as input of the sensors."""
    loop, truths = Loop(load_scenario("circle", {"plant.kind": "bicycle"})), []
    for _ in range(80):
        truths.append(loop.truth)
        loop.advance(loop.tick().drive)
    return truths


def sensed(truths, *tables):
    gnss, on = Gnss(dual_antenna=DualAntenna(enabled=True)), {"enabled": True}
    sensors, days = Sensors(gnss=gnss, gyro=on, wheel_speed=on), scripted(faults(*tables), len(truths))
    state, measurements = sensors.init(1), []
    for truth, day in zip(truths, days, strict=True):
        state, measurement = sensors.measure(state, truth, day, TICK_S)
        measurements.append(measurement)
    return measurements


@pytest.mark.parametrize("kind", SENSED)
def test_sensor_fault_changes_only_its_sensor_within_its_time_window(drive, kind):
    good, ill = sensed(drive), sensed(drive, {"kind": kind, "start_s": 1, "end_s": 2})
    parts = {"gnss": "fix", "heading": "fix", "steering_pot": "steer", "pedal_pot": "pedal", "gyro": "gyro"}
    struck = {**parts, "wheel_speed": "wheel_speed"}.get(next((p for p in (*parts, "wheel_speed") if p in kind), ""))
    for channel in ("fix", "steer", "pedal", "gyro", "wheel_speed"):
        changed = [k for k in range(80) if getattr(good[k], channel) != getattr(ill[k], channel)]
        if channel == struck:
            assert min(changed) == 20
            assert max(changed) == 39
        else:
            assert not changed, channel


# --- overlaps -----------------------------------------------------------------------------------------------------


def test_two_overlapping_faults_of_the_same_kind_are_rejected():
    message = refused({"kind": "gnss_loss", "end_s": 30}, {"kind": "friction"}, {"kind": "gnss_loss", "start_s": 20})
    assert message == (
        "mine.toml: fault[2]: this gnss_loss fault (20 to the end) overlaps fault[0] (0 to 30 s); "
        "end one before the start of the other"
    )


def test_fault_may_begin_when_another_fault_of_its_kind_ends():
    first, second = faults({"kind": "gnss_loss", "end_s": 30}, {"kind": "gnss_loss", "start_s": 30})
    assert [(f.active(29.95), f.active(30.0)) for f in (first, second)] == [(True, False), (False, True)]


@pytest.mark.parametrize("order", [1, -1])
def test_overlapping_gnss_faults_give_the_worse_quality_in_any_order(order):
    tables = [{"kind": "gnss_float", "end_s": 20}, {"kind": "gnss_loss", "start_s": 5, "end_s": 10}]
    quality = [day.gnss_quality for day in conditions(*tables[::order], seconds=25.0)]
    assert quality == 100 * [Quality.FLOAT] + 100 * [Quality.NONE] + 200 * [Quality.FLOAT] + 100 * [Quality.FIX]


@pytest.mark.parametrize(
    ("table", "field", "once", "twice"),
    [
        ({"kind": "gnss_latency", "latency_s": 0.2}, "gnss_latency_s", 0.2, 0.4),
        ({"kind": "gnss_jump", "north_m": 2.0}, "gnss_offset", (0, 2), (0, 4)),
        ({"kind": "steering_pot_bias", "bias_deg": 3.0}, "steering_pot.offset", np.radians(3), np.radians(6)),
        ({"kind": "gyro_scale", "scale": 0.5}, "gyro.scale", 0.5, 0.25),
        ({"kind": "valve_delay", "delay_s": 0.5}, "valve.delay_s", 0.5, 1.0),
        ({"kind": "valve_wear", "gain_share": 0.5}, "valve_gain", 0.5, 0.25),
        ({"kind": "valve_wear", "dead_band_v": 0.5}, "valve_dead_band", 0.5, 1.0),
    ],
)
def test_effect_of_a_fault_is_combined_with_existing_conditions(table, field, once, twice):
    (fault,) = faults(table)
    _, one = fault.apply(None, NOMINAL, 0.0, TICK_S)
    _, two = fault.apply(None, one, 0.0, TICK_S)
    assert attrgetter(field)(one) == pytest.approx(once)
    assert attrgetter(field)(two) == pytest.approx(twice)


def test_effects_of_faults_of_different_kinds_add_up():
    day = conditions({"kind": "gnss_latency"}, {"kind": "gnss_loss"}, {"kind": "steering_pot_stuck"})[0]
    assert day == NOMINAL._replace(gnss_quality=Quality.NONE, gnss_latency_s=0.2, steering_pot=Distortion(stuck="last"))


# --- what is refused ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "gnss_loss", "start_s": 5, "end_s": 3}, "fault[0].end_s: must be above start_s (5), got 3"),
        ({"kind": "gnss_loss", "start_s": 5, "end_s": 5}, "fault[0].end_s: must be above start_s (5), got 5"),
        ({"kind": "gnss_loss", "start_s": -1}, "fault[0].start_s: must be at least 0, got -1"),
        ({"kind": "gnss_loss", "end_s": -1}, "fault[0].end_s: must be above 0, got -1"),
        ({"kind": "gnss_loss", "start_s": float("nan")}, "fault[0].start_s: must be a finite number"),
        ({"kind": "gnss_loss", "end_s": float("inf")}, "fault[0].end_s: must be a finite number"),
        ({"kind": "gnss_los"}, "fault[0].kind: unknown kind 'gnss_los'; did you mean 'gnss_loss'?"),
        ({"start_s": 3}, "fault[0].kind: is missing (known: "),
        ({"kind": "gnss_loss", "strat_s": 3}, "fault[0].strat_s: unknown key; did you mean 'start_s'?"),
        ({"kind": "gnss_latency", "latency_s": 0.12}, "fault[0].latency_s: 0.12 is not a multiple of the 0.05 s tick"),
        ({"kind": "gnss_latency", "latency_s": 9}, "fault[0].latency_s: must be at most 5"),
        ({"kind": "gnss_float", "jump_interval_s": 0.01}, "fault[0].jump_interval_s: must be at least 0.05"),
        ({"kind": "gnss_float", "flicker_s": 0}, "fault[0].flicker_s: must be at least 0.05"),
        ({"kind": "gnss_float", "jump_sigma_m": -1}, "fault[0].jump_sigma_m: must be at least 0"),
        ({"kind": "steering_pot_bias", "bias_deg": 100}, "fault[0].bias_deg: must be at most 90"),
        ({"kind": "steering_pot_bias", "ramp_s": -1}, "fault[0].ramp_s: must be at least 0"),
        ({"kind": "valve_wear", "gain_share": 1.2}, "fault[0].gain_share: must be at most 1"),
        ({"kind": "gnss_frozen", "keep": "all"}, "fault[0].keep: "),
        ({"kind": "gyro_stuck", "value": "first"}, "fault[0].value: "),
        ({"kind": "gyro_scale", "scale": -11}, "fault[0].scale: must be at least -10"),
        ({"kind": "valve_delay", "delay_s": 0.12}, "fault[0].delay_s: 0.12 is not a multiple of the 0.05 s tick"),
        ({"kind": "valve_wear", "dead_band_v": 7}, "fault[0].dead_band_v: must be at most 6"),
        (3, "fault[0]: must be a table, got 3"),
    ],
)
def test_error_for_an_impossible_fault_value_names_the_key(table, message):
    assert refused(table).startswith(f"mine.toml: {message}")


@pytest.mark.parametrize("kind", KINDS)
def test_bicycle_model_accepts_only_sensor_and_valve_faults(kind):
    data = {"fault": [{"kind": kind}], "plant": {"kind": "bicycle"}}
    if kind in SENSED:
        assert resolve(data, "b").fault[0].kind == kind
    else:
        with pytest.raises(
            ScenarioError, match=rf"fault\[0\]\.kind: '{kind}' acts on a part that the bicycle .* \"mujoco\""
        ):
            resolve(data, "b")


# --- on the command line ------------------------------------------------------------------------------------------


@pytest.fixture
def call(call):
    """Return a function that runs a scenario text for 2 s on the bicycle: exit status, stdout and stderr."""

    def start(text, *sets, out="out"):
        Path("mine.toml").write_text(text)
        changes = [word for key in ("duration_s=2", "plant.kind=bicycle", *sets) for word in ("--set", key)]
        return call("run", "mine.toml", "--no-rrd", "--out", out, *changes)

    return start


LOSS = '[[fault]]\nkind = "gnss_loss"\nstart_s = 0.5\nend_s = 1\n'
BAD = [
    (
        LOSS + LOSS.replace("0.5", "0.8"),
        (),
        ("fault[1]: this gnss_loss fault (0.8 to 1 s) overlaps fault[0]", "(0.5 to 1 s)"),
    ),
    ('[fault]\nkind = "gnss_loss"\n', (), ("fault: must be a list of tables; write [[fault]]",)),
    ("fault = 3\n", (), ("fault: must be a list, got 3",)),
    (LOSS, ("fault.9.x=1",), ("--set fault.9.x: the scenario has 1 tables [[fault]], and 0 is the first",)),
    (LOSS, ("fault.x=1",), ("--set fault.x: fault is a list; specify fault.0.key=value",)),
    (LOSS, ("fault.x.y=1",), ("--set fault.x.y: fault is a list; specify fault.0.key=value",)),
    ("", ("fault.0.end_s=1",), ("--set fault.0.end_s: the scenario has 0 tables [[fault]]",)),
    (LOSS, ("fault.0.end_s=0.2",), ("fault[0].end_s: must be above start_s (0.5), got 0.2",)),
    (LOSS, ("fault.0.kind=friction",), ("fault[0].kind: 'friction' acts on a part that the bicycle",)),
]


@pytest.mark.parametrize(("text", "sets", "messages"), BAD, ids=[str(k) for k in range(len(BAD))])
def test_invalid_fault_gives_exit_status_2_and_one_message(call, text, sets, messages):
    status, out, err = call(text, *sets)
    assert (status, out) == (2, "")
    assert all(message in err for message in messages)
    assert "Traceback" not in err
    assert not Path("out").exists()


def test_fault_keys_can_be_overridden_individually(call):
    assert call(LOSS, "fault.0.end_s=40", "fault.0.kind=gnss_float", "fault.0.flicker_s=2.0")[0] == 0
    (fault,) = load_scenario("out/scenario.toml").fault
    assert (fault.kind, fault.start_s, fault.end_s, fault.flicker_s) == ("gnss_float", 0.5, 40.0, 2.0)


def test_list_of_faults_can_be_overridden_as_a_whole(call):
    assert call("", 'fault=[{kind="gnss_loss", end_s=1}]')[0] == 0
    assert load_scenario("out/scenario.toml").fault[0].end_s == 1.0


def test_run_with_faults_is_reproduced_from_its_written_scenario(call):
    text = LOSS + '[[fault]]\nkind = "gnss_float"\nflicker_s = 0.2\n[[fault]]\nkind = "valve_wear"\nramp_s = 1\n'
    assert call(text, out="first")[0] == 0
    assert call(Path("first/scenario.toml").read_text(), out="second")[0] == 0
    for name in ("signals.parquet", "scenario.toml"):
        assert Path("first", name).read_bytes() == Path("second", name).read_bytes()
    assert load_scenario("first/scenario.toml").hash8 == load_scenario("second/scenario.toml").hash8


def test_at_most_a_thousand_faults_are_accepted():
    def losses(count):
        return {"fault": [{"kind": "gnss_loss", "start_s": float(k), "end_s": k + 0.5} for k in range(count)]}

    assert len(load_scenario("straight_line", losses(1000)).fault) == 1000
    with pytest.raises(ScenarioError, match=r"fault: must have at most 1000 items$"):
        load_scenario("straight_line", losses(1001))

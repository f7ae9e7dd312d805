import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.control import OpenLoop, Pd, PdIsgn, PdT2fnn


@pytest.mark.parametrize("kind", ["pd_t2fnn", "pd_t1fnn"])
@pytest.mark.parametrize(("rules_1", "rules_2"), [(3, 3), (2, 4)])
def test_logged_network_parameters_reproduce_the_logged_output(kind, rules_1, rules_2):
    size = {"controller.network.rules_1": rules_1, "controller.network.rules_2": rules_2}
    column = run(load_scenario("circle", {"duration_s": 8, "controller.kind": kind, **size})).column
    rules = [f"{i}_{j}" for i in range(rules_1) for j in range(rules_2)]
    f, lower, upper = (np.array([column(f"{name}_{rule}") for rule in rules]) for name in ("f", "w_lower", "w_upper"))
    q = column("q")
    np.testing.assert_allclose(q * (f * lower).sum(0) + (1 - q) * (f * upper).sum(0), column("tau_n"), atol=1e-15)
    np.testing.assert_allclose(lower.sum(0), 1.0)
    np.testing.assert_allclose(upper.sum(0), 1.0)
    assert np.ptp(f) > 0


def test_logged_firing_strengths_match_logged_centres_and_widths():
    column = run(load_scenario("circle", {"duration_s": 8, "controller.kd": 0.01})).column
    x1 = column("e_yaw_rate")
    mu = np.array([1 - abs(x1 - column(f"c1_{i}")) / column(f"d1_upper_{i}") for i in range(3)])
    fractions = np.array([sum(column(f"w_upper_{i}_{j}") for j in range(3)) for i in range(3)])
    np.testing.assert_allclose(fractions, mu / mu.sum(0), atol=1e-9)


def test_only_network_controllers_report_network_columns():
    for controller in (OpenLoop(), Pd(), PdIsgn()):
        assert controller.columns == ()
        assert controller.report(controller.init()) == ()
    network = PdT2fnn()
    assert len(network.columns) == len({column.name for column in network.columns}) == 45
    assert np.isnan(network.report(network.init())).all()

"""Short versions of the soak runs report and fail as required; `make soak` runs the long versions."""

import soak


def test_network_parameters_stay_bounded_in_a_soak_test(capsys):
    assert soak.learning(5000)
    out = capsys.readouterr().out
    assert "learning: 5e+03 ticks" in out
    assert out.count(" ticks: q ") == 10


def test_soak_test_detects_runaway_or_non_finite_parameters(monkeypatch):
    assert soak.largest(soak.PdT2fnn().network.init(0.0, 0.0)._replace(q=float("nan"))) == float("inf")
    monkeypatch.setattr(soak, "BOUND", 0.1)
    assert not soak.learning(100)


def test_soak_test_of_half_a_minute_prints_its_result(monkeypatch, capsys):
    monkeypatch.setattr(soak, "SETTLED_S", 10.0)
    assert soak.drive_for(30 / 3600, recorded=False)
    out = capsys.readouterr().out
    assert "work: completed after 0.01 h" in out
    assert "memory [MB]: " in out


def test_soak_test_with_growing_memory_use_fails(monkeypatch):
    grown = iter(range(100, 10_000, 60))
    monkeypatch.setattr(soak, "SETTLED_S", 5.0)
    monkeypatch.setattr(soak, "memory_mb", lambda peak=False: float(next(grown)))
    assert not soak.drive_for(30 / 3600, recorded=False)

"""Signals: delayed within a block, delivered between two steps, and never lost."""

import os
import signal
import threading

import pytest

from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.core import interrupts
from agrobot_mj.core.interrupts import deferring, deliver, held_back, raised_by_handler, until_the_end

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="POSIX signals")


class StoppedError(Exception):
    """Exception raised by a signal handler."""


@pytest.fixture
def received():
    """Yield a list of the signal numbers that the handlers of a user have received."""
    numbers = []
    before = {n: signal.signal(n, lambda n, frame: numbers.append(n)) for n in (signal.SIGINT, signal.SIGUSR1)}
    yield numbers
    for number, old in before.items():
        signal.signal(number, old)


def raising(number, frame):
    raise StoppedError(number)


def send(*numbers):
    for number in numbers:
        os.kill(os.getpid(), number)


def test_signal_handlers_run_at_the_end_of_the_outermost_with_block(received):
    with held_back():
        with held_back():
            send(signal.SIGINT, signal.SIGUSR1)
        assert received == []
    assert sorted(received) == [signal.SIGINT, signal.SIGUSR1]
    send(signal.SIGINT)
    assert received.count(signal.SIGINT) == 2


def test_remaining_signal_handlers_run_after_one_handler_raises(received):
    signal.signal(signal.SIGINT, raising)
    with pytest.raises(StoppedError), held_back():
        send(signal.SIGINT, signal.SIGUSR1)
    assert received == [signal.SIGUSR1]
    assert signal.getsignal(signal.SIGINT) is raising


def test_deferred_signals_are_delivered_only_between_steps(received):
    with deferring():
        send(signal.SIGUSR1)
        with held_back():
            deliver()
            assert received == []
        assert received == []
        deliver()
        assert received == [signal.SIGUSR1]
        send(signal.SIGUSR1)
        assert received == [signal.SIGUSR1]
    assert received == 2 * [signal.SIGUSR1]


def test_exceptions_of_signal_handlers_are_distinguished_from_errors(received):
    signal.signal(signal.SIGUSR1, raising)
    with deferring():
        send(signal.SIGUSR1)
        with pytest.raises(StoppedError) as found:
            deliver()
        assert raised_by_handler(found.value)
        assert not raised_by_handler(StoppedError())
        send(signal.SIGINT)
        assert received == []
    assert received == [signal.SIGINT]


def test_default_and_ignored_signal_actions_remain_unchanged(received):
    before = signal.signal(signal.SIGUSR1, signal.SIG_IGN), signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with held_back():
            assert signal.getsignal(signal.SIGUSR1) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        for number, old in zip((signal.SIGUSR1, signal.SIGTERM), before, strict=True):
            signal.signal(number, old)


def test_signal_handler_set_inside_a_with_block_remains_set_afterwards(received):
    with held_back():
        signal.signal(signal.SIGINT, raising)
    assert signal.getsignal(signal.SIGINT) is raising


def test_signal_handler_saved_inside_a_with_block_works_afterwards(received):
    with held_back():
        saved = signal.signal(signal.SIGINT, raising)
    signal.signal(signal.SIGINT, saved)
    send(signal.SIGINT)
    assert received == [signal.SIGINT]


def test_signal_interrupts_a_with_block_that_exceeds_its_time_limit(received, monkeypatch):
    monkeypatch.setattr(interrupts, "PATIENCE_S", -1.0)
    signal.signal(signal.SIGINT, raising)
    with held_back(), pytest.raises(StoppedError):
        send(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is raising


def test_delayed_signal_is_handled_after_compilation_in_a_slow_with_block(received, monkeypatch):
    monkeypatch.setattr(interrupts, "PATIENCE_S", 0.0)
    with held_back():
        with until_the_end(), until_the_end():
            send(signal.SIGUSR1)
            assert received == []
        assert received == [signal.SIGUSR1]
    monkeypatch.setattr(interrupts, "PATIENCE_S", 60.0)
    with held_back():
        with until_the_end():
            send(signal.SIGUSR1)
        assert received == [signal.SIGUSR1]
    assert received == [signal.SIGUSR1] * 2


def test_deferred_signal_is_handled_at_the_end_of_c_code(received):
    with deferring():
        with until_the_end():
            send(signal.SIGUSR1)
            assert received == []
        assert received == [signal.SIGUSR1]


def test_first_signal_stops_a_running_simulation_and_cancels_its_start():
    with stop_on_signals() as stop:
        with pytest.raises(KeyboardInterrupt):
            send(signal.SIGINT)
        assert stop(), "also if the exception was discarded"
    with stop_on_signals() as stop:
        assert not stop()
        send(signal.SIGINT)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            send(signal.SIGINT)


def test_signals_are_not_delayed_in_other_threads(received):
    entered, leave = threading.Event(), threading.Event()

    def work():
        with held_back():
            entered.set()
            leave.wait(60.0)

    thread = threading.Thread(target=work)
    thread.start()
    assert entered.wait(60.0)
    send(signal.SIGINT)
    assert received == [signal.SIGINT]
    leave.set()
    thread.join()

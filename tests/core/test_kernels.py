"""Kernels: freed arrays, immutable states, and compilation for given argument types."""

import os
import pickle
import signal
import sys
from collections import namedtuple
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from numba import config
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys

from agrobot_mj import load_scenario
from agrobot_mj.core import interrupts
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held, Reference
from agrobot_mj.core.kernel_cache import CACHE
from agrobot_mj.core.kernels import bound, fetched, held, jit, stage
from agrobot_mj.core.machine_code import _Library
from agrobot_mj.core.signals import NOMINAL, Drive, Vector
from agrobot_mj.core.spec import every
from agrobot_mj.plants import Bicycle, BicyclePlant, Mujoco, MujocoPlant
from agrobot_mj.plants.base import Motion
from agrobot_mj.terrain import Rough
from agrobot_mj.terrain.grid import height_and_gradient, plane
from agrobot_mj.tyres import Tyre

compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")


def doubled(x):
    out = np.empty(2)
    out[:] = 2 * x
    return out[0] + out[1]


def tripled(x):
    return np.full(3, x)


def arrays_lost(work):
    """Return the number of arrays of compiled code that are not freed after `work`."""
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        work()
        after = rtsys.get_allocation_stats()
        return after.alloc - before.alloc - (after.free - before.free)
    finally:
        _nrt_python.memsys_disable_stats()


@compiled
@pytest.mark.parametrize("tyre", [tyre() for tyre in every(Tyre)], ids=lambda tyre: tyre.kind)
def test_kernels_do_not_leak_arrays(tyre):
    """Both ground types, every tyre and all loads are simulated. A kernel that leaks an array checks the count."""
    kept, making = [], jit(tripled)
    making(1.0)
    assert arrays_lost(lambda: kept.append(making(1.0))) == 1
    s = load_scenario("straight_line")
    day = NOMINAL._replace(drawbar=300.0, side_force=200.0)
    for ground in (s.terrain.ground(), Rough(half_size_m=20.0).ground()):
        plant = MujocoPlant(Mujoco(tyre=tyre, settle_s=0.5), s.vehicle, ground)
        plant.reset(s.path.at(0.0))
        plant.advance(Drive(7.0, 8.0), day)
        assert (
            arrays_lost(lambda plant=plant: [plant.advance_held(Drive(7.0, 8.0), day) for _ in range(20)] and None) == 0
        )
    bicycle = BicyclePlant(Bicycle(), s.vehicle, s.terrain.ground())
    bicycle.reset(s.path.at(0.0))
    assert arrays_lost(lambda: [bicycle.advance(Drive(7.0, 8.0)) for _ in range(20)] and None) == 0


@compiled
def test_compiled_results_are_constructed_without_python_calls():
    """During a Python call, a signal handler could raise an exception in the middle of compiled code."""
    plant = MujocoPlant(Mujoco(settle_s=0.0), load_scenario("hills").vehicle, plane(0.0, 0.0, 5.0))

    def work():
        return plant._observe(plant.rig, 0.0)[1], making(3.0)

    making = jit(tripled)
    expected, calls = work(), []
    sys.setprofile(lambda frame, event, argument: calls.append(frame.f_code.co_name) if event == "call" else None)
    try:
        found = work()
    finally:
        sys.setprofile(None)
    assert set(calls) <= {"work", "tripled"}  # numba announces its own kernels that are not bound
    assert found[0] == expected[0]
    assert type(found[0].cg) is type(expected[0].cg) is Motion


@pytest.mark.skipif(CACHE is None, reason="nothing is kept")
def test_kernel_with_argument_types_of_other_packages_is_not_cached():
    """Another process may lack the class of an argument, and the cache would not detect changes of its source."""

    def kept():
        return {file: file.read_bytes() for file in CACHE.rglob("*height_and_gradient*")}

    ground = plane(0.1, -0.2, 5.0)
    expected = bound(height_and_gradient, ground, 0.0, 0.0)(ground, 1.0, 2.0)
    before = kept()
    assert before
    own = namedtuple("Own", ground._fields, module=__name__)(*ground)
    assert bound(height_and_gradient, own, 0.0, 0.0)(own, 1.0, 2.0) == expected
    assert kept() == before


def test_kernel_with_bound_signature_gives_the_same_result():
    ground = plane(0.1, -0.2, 5.0)
    height = bound(height_and_gradient, ground, 0.0, 0.0)
    for x, y in np.random.default_rng(0).uniform(-6.0, 6.0, (20, 2)):
        assert height(ground, x, y) == height_and_gradient(ground, x, y)
    assert height(ground, 1, 2) == height_and_gradient(ground, 1.0, 2.0)


class Half(NamedTuple):
    """Test record of a stage."""

    value: float
    parts: tuple[int, bool]


def halves(half: Half, more: Vector) -> tuple[Half, float]:
    """Return a record with half of the value, and the sum of the values."""
    return Half(0.5 * half.value, half.parts), half.value + more[0]


def test_argument_types_of_a_stage_function_come_from_its_annotations():
    halved, more = stage(halves), np.array([0.25])
    assert halved(Half(1, (2, True)), more) == (Half(0.5, (2, True)), 1.25)
    found, total = halved(Half(1.5, (3, False)), more)
    assert (found, total) == (Half(0.75, (3, False)), 1.75)
    assert type(found) is Half


class StoppedError(Exception):
    """Exception raised by a signal handler."""


@contextmanager
def signals_in_callbacks(monkeypatch):
    """Send a signal in each callback in which LLVM provides machine code or requests cached code."""
    engine = cpu_target.target_context.codegen()._engine._ee

    def stop(number, frame):
        raise StoppedError

    def after_signal(callback, *arguments):
        os.kill(os.getpid(), signal.SIGUSR1)
        return callback(*arguments)

    before = signal.signal(signal.SIGUSR1, stop)
    try:
        with monkeypatch.context() as patch:
            for name in ("_object_cache_notify", "_object_cache_getbuffer"):
                patch.setattr(engine, name, partial(after_signal, getattr(engine, name)))
            yield
    finally:
        signal.signal(signal.SIGUSR1, before)


@compiled
@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="POSIX signals")
@pytest.mark.parametrize("function", [doubled, wrap], ids=["compiled", "cached"])
def test_signal_during_code_generation_is_raised_afterwards(function, monkeypatch):
    wanted = jit(function)(1.5)  # from now on the code of `wrap` is cached
    monkeypatch.setattr(interrupts, "PATIENCE_S", -1.0)  # as in a block that has been open for long
    with signals_in_callbacks(monkeypatch):
        for _ in range(2):
            with pytest.raises(StoppedError):
                jit(function)(1.5)
    assert jit(function)(1.5) == wanted


@compiled
@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="POSIX signals")
def test_deferred_signal_interrupts_a_compilation_between_functions(monkeypatch):
    inner, finished, finalize = jit(reciprocal), [], _Library._finalize_final_module

    @jit
    def outer(x):
        return 2.0 * inner(x)

    def stop(number, frame):
        raise StoppedError

    def after_signal(library):
        os.kill(os.getpid(), signal.SIGUSR1)
        finalize(library)
        finished.append(library.name)

    before = signal.signal(signal.SIGUSR1, stop)
    try:
        with monkeypatch.context() as patch, interrupts.deferring():
            patch.setattr(_Library, "_finalize_final_module", after_signal)
            with pytest.raises(StoppedError):
                outer(4.0)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert finished == []
    assert outer(4.0) == 0.5


def reciprocal(x):
    if x == 0.0:
        raise ZeroDivisionError("no reciprocal of zero")
    return 1.0 / x


@compiled
def test_machine_code_is_only_generated_for_functions_called_from_python(monkeypatch):
    inner, generated = jit(reciprocal), []

    @jit
    def outer(x):
        return 2.0 * inner(x)

    before = _Library._generate
    monkeypatch.setattr(_Library, "_generate", lambda library: (generated.append(library.name[-5:]), before(library)))
    assert outer(4.0) == 0.5
    assert generated == ["outer"]
    with pytest.raises(ZeroDivisionError, match="no reciprocal of zero"):
        outer(0.0)
    assert inner(4.0) == 0.25
    assert generated == ["outer", "rocal"]


class Pair(NamedTuple):
    number: float
    numbers: Vector


@stage
def scaled(pair: Held[Pair], by: float) -> tuple[Held[Pair], float]:
    pair = fetched(pair)
    return held(Pair(by * pair.number, by * pair.numbers)), by + pair.number


def test_state_held_by_reference_is_immutable_and_can_be_pickled():
    first = held(Pair(2.0, np.array([1.0, 4.0])))
    second, total = scaled(first, 3.0)
    assert total == 5.0
    for reference, number, numbers in ((first, 2.0, [1.0, 4.0]), (second, 6.0, [3.0, 12.0])):
        for same in (reference, pickle.loads(pickle.dumps(reference))):
            assert fetched(same).number == number
            assert fetched(same).numbers.tolist() == numbers


@compiled
def test_compiled_stage_rejects_a_state_that_is_not_from_held():
    with pytest.raises(TypeError, match=r"scaled: argument 1 must be a reference from held\(\), got Pair"):
        scaled(Pair(2.0, np.zeros(3)), 3.0)


@compiled
def test_stage_function_returns_a_state_reference_and_frees_unused_states():
    state = held(Pair(2.0, np.zeros(3)))
    assert type(scaled(state, 3.0)[0]) is Reference
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for _ in range(20):
            state, _ = scaled(state, 0.5)
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc == after.free - before.free == 40


class Scaling(NamedTuple):
    pair: Held[Pair]
    by: float


@stage
def scaled_in(scaling: Scaling) -> float:
    return scaling.by * fetched(scaling.pair).numbers[1]


def test_state_referenced_in_a_named_tuple_argument_is_freed():
    assert scaled_in(Scaling(held(Pair(2.0, np.array([1.0, 4.0]))), 3.0)) == 12.0

    def work():
        state = held(Pair(2.0, np.array([1.0, 4.0])))
        for by in range(20):
            state, _ = scaled(state, 0.5)
            assert scaled_in(Scaling(state, float(by))) == by * fetched(state).numbers[1]

    if not config.DISABLE_JIT:
        assert arrays_lost(work) == 0

"""Cache of compiled kernels: damaged files are compiled again, and a user without a home folder has a cache."""

import sys
from threading import Thread

import pytest
from numba import config, njit

from agrobot_mj.core import kernel_cache
from agrobot_mj.core.kernel_cache import PackageCache
from agrobot_mj.machine.hydraulics import beyond_play

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
DAMAGE = {
    "empty": lambda data: b"",
    "noise": lambda data: bytes(range(7, 207)),
    "short": lambda data: data[:33],
    "cut": lambda data: data[:-90],
    "longer": lambda data: data + b"\0",
    "one bit": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 8]) + data[len(data) // 2 + 1 :],
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    kernel_cache._tell.cache_clear()
    return tmp_path


def fresh(function=beyond_play):
    """Return a kernel of the package, either compiled again or loaded from the cache."""
    made = njit(nogil=True)(function.py_func)
    made._cache = PackageCache(function.py_func)
    return made


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_kernel_with_damaged_cache_file_is_recompiled(folder, capsys, ending, damage):
    expected = fresh()(0.31, 0.02)
    for file in folder.rglob(f"*.{ending}"):
        file.write_bytes(damage(file.read_bytes()))
    again = fresh()
    assert again(0.31, 0.02) == expected
    assert sum(again.stats.cache_hits.values()) == 0
    assert capsys.readouterr().err.count("damaged compiled kernels are discarded") == 1
    loaded = fresh()
    assert loaded(0.31, 0.02) == expected
    assert sum(loaded.stats.cache_hits.values()) == 1
    assert capsys.readouterr().err == ""


def test_cache_file_of_another_kernel_is_reported_as_damaged(folder, capsys):
    for value in (0.31, 1):
        fresh()(value, 0.02)
    one, two = sorted(folder.rglob("*.nbc"))
    contents = one.read_bytes(), two.read_bytes()
    one.write_bytes(contents[1])
    two.write_bytes(contents[0])
    assert fresh()(0.31, 0.02) == pytest.approx(0.29)
    assert "damaged" in capsys.readouterr().err


def test_kernel_works_without_cache_when_the_disk_is_full(folder, monkeypatch):
    def full(self, path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(kernel_cache._CheckedFile, "_open_for_write", full)
    assert fresh()(0.31, 0.02) == pytest.approx(0.29)


def homeless(*_):
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX owners")
def test_user_without_home_folder_gets_a_private_temporary_cache(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "user_cache_path", homeless)
    monkeypatch.setattr(kernel_cache.tempfile, "gettempdir", lambda: str(tmp_path))
    made = kernel_cache._cache()
    assert made.is_relative_to(tmp_path)
    assert kernel_cache._cache() == made
    (private,) = tmp_path.iterdir()
    assert private.stat().st_mode & 0o777 == 0o700
    private.chmod(0o777)  # others could write code there, which would be run
    assert kernel_cache._cache() is None


@pytest.mark.parametrize(("patience", "hits"), [(60.0, 1), (0.2, 0)])
def test_kernel_waits_while_another_process_compiles_the_kernel(folder, monkeypatch, patience, hits):
    monkeypatch.setattr(kernel_cache, "PATIENCE_S", patience)
    one, other = fresh(), fresh()

    def load():
        with other._cache.compiling():
            other(0.31, 0.02)

    waiting = Thread(target=load)
    with one._cache.compiling():
        waiting.start()
        waiting.join(0.5 if hits else 60.0)
        assert waiting.is_alive() is bool(hits)
        one(0.31, 0.02)
    waiting.join(60.0)
    assert sum(other.stats.cache_hits.values()) == hits
    with one._cache.compiling(), one._cache.compiling():  # code exists: nothing is locked
        pass

"""The store of compiled kernels: shipped code is loaded, and trouble with the store changes no result."""

import errno
import os
import signal
import subprocess
import sys
import time

import pytest

from sshade.core import kernel_store
from sshade.core.kernel_store import portable_target
from sshade.core.kernels import kernel

OURS = "from sshade.core.kernels import kernel\n\n\n@kernel\ndef total(x):\n    return x.sum()\n"
OTHER = "import numba\n\n\n@numba.njit(cache=True)\ndef double(x):\n    return 2 * x\n"
#: Prints the functions that are compiled by calls of both, and a setting of numba.
CALLS = """
import numba
import numpy as np
from numba.core import event
from numba.core.dispatcher import Dispatcher

class Names(event.Listener):
    def on_start(self, event):
        print(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

import other
event.register("numba:compile", Names())
import ours
assert ours.total(np.ones(3)) == 3 and other.double(2) == 4
print(numba.config.CPU_NAME)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with two modules, where the store is the folder `store`."""
    (tmp_path / "ours.py").write_text(OURS)
    (tmp_path / "other.py").write_text(OTHER)
    monkeypatch.setenv("SSHADE_KERNELS", str(tmp_path / "store"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    return tmp_path


def printed(folder, **environment):
    told = {"cwd": folder, "env": os.environ | environment}
    done = subprocess.run([sys.executable, "-c", CALLS], capture_output=True, text=True, **told)
    assert done.returncode == 0 and not done.stderr, done.stderr
    return [line for line in done.stdout.split() if line in ("total", "double", "None", "x86-64-v3")]


@pytest.mark.skipif(portable_target() is None, reason="no level of processors is known here")
def test_shipped_kernels_are_loaded_until_their_source_changes_and_other_packages_keep_their_own(folder):
    """Kernels for the common level serve a process that has imported numba before."""
    _, level, features = portable_target()
    build = {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": features}
    assert printed(folder, **build) == ["total", "double", level]
    assert printed(folder) == ["double", "None"]
    assert [path.name.partition("-")[0] for path in (folder / "store").iterdir()] == ["ours.total"]
    kept = {path.name.partition("-")[0] for path in (folder / "__pycache__").glob("*.nb?")}
    assert kept == {"other.double"}
    (folder / "ours.py").write_text(OURS.replace("return x.sum()", "return x.sum() + 0 * x[0]"))
    assert printed(folder) == ["total", "None"]


def store_of_one(folder):
    """Return a kernel that is compiled and kept in the store, and its file."""
    found = kernel(lambda x: x + 1)
    assert found(1.0) == 2.0
    (path,) = (folder / "store").iterdir()
    return found, path


@pytest.mark.parametrize("damage", [lambda data: data[:-5], lambda data: data[:-1] + b"?"])
def test_a_damaged_file_is_compiled_and_written_again(folder, damage):
    found, path = store_of_one(folder)
    sound = path.read_bytes()
    path.write_bytes(damage(sound))
    again = kernel(found.py_func)
    assert again(1.0) == 2.0 and not again.stats.cache_hits
    assert len(path.read_bytes()) == pytest.approx(len(sound), rel=0.1)
    last = kernel(found.py_func)
    assert last(1.0) == 2.0 and last.stats.cache_hits


@pytest.mark.parametrize("name", ["numba.__version__", "sys.implementation.cache_tag"])
def test_code_of_another_numba_or_python_is_compiled_again(folder, monkeypatch, name):
    found, _ = store_of_one(folder)
    monkeypatch.setattr(name, "other")
    again = kernel(found.py_func)
    assert again(1.0) == 2.0 and not again.stats.cache_hits and len([*(folder / "store").iterdir()]) == 2


def test_kernels_are_kept_in_the_first_folder_that_can_be_written_and_found_there(folder, monkeypatch):
    monkeypatch.setattr(kernel_store, "folders", lambda: [folder / "ours.py", folder / "store"])
    found, _ = store_of_one(folder)
    again = kernel(found.py_func)
    assert again(1.0) == 2.0 and again.stats.cache_hits


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_a_store_that_cannot_be_written_costs_a_warning(folder, monkeypatch, code):
    def fails(path, content):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(kernel_store, "_replace", fails)
    with pytest.warns(UserWarning, match=f"compiles again.*{os.strerror(code)}"):
        assert kernel(lambda x: x + 2)(1.0) == 3.0


def test_an_interrupt_lets_a_kernel_load_to_the_end(folder, monkeypatch):
    told = []

    def interrupted(store, *_):
        told.append("begin")
        if len(told) == 1:
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.1)
        told.append("end")

    monkeypatch.setattr(kernel_store.Store, "load_overload", interrupted)
    found = kernel(lambda x: x + 3)
    # A program in the background of a shell ignores the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            found(1.0)
    finally:
        signal.signal(signal.SIGINT, before)
    assert found(1.0) == 4.0 and told.count("begin") == told.count("end")

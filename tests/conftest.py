"""Settings and fixtures of all tests: reproducible property tests, and a few meshes that are built once."""

import gc
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

# Numpy reads this variable when it is imported. BLAS threads wait busily, and parallel tests share the cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from numba.core import event

from sshade import Mesh
from sshade.core.kernel_store import Store, describe
from tests.browser import browser as browser
from tests.robustness.inputs import write_sound
from tests.shapes import bumpy
from tools.compile_kernels import LIST

# Child processes import the packages of this folder.
ROOT = Path(__file__).parents[1]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))

LISTED = set(LIST.read_text("utf-8").splitlines())

settings.register_profile("reproducible", derandomize=True, deadline=None, database=None, max_examples=25)
settings.register_profile("thorough", settings.get_profile("reproducible"), max_examples=600)
settings.load_profile("reproducible")


@pytest.fixture(scope="session")
def body() -> Mesh:
    """Closed, no symmetry, 642 vertices."""
    return bumpy(3)


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A new folder, which is the working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def sound(here) -> Path:
    """A new folder with a sound mesh, body.ply, and a sound pose, pose.json; it is the working folder."""
    write_sound()
    return here


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Iterator[None]:
    """Fail a test that compiles a kernel outside the list, because users would wait for its compilation.

    Log handlers that the test leaves are removed: Hydra's write to a stream that is closed after the test.
    Threads in which sessions of the editor prepare come to their end: their memory would count in the next
    test.
    """
    unlisted, handlers, level = [], logging.root.handlers[:], logging.root.level

    class Compilations(event.Listener):
        def on_start(self, event):
            store = event.data["dispatcher"]._cache
            if isinstance(store, Store) and store.name.startswith(("sshade.", "baselines.", "eval.")):
                line = f"{store.name} {describe(event.data['args'])}"
                if line not in LISTED:
                    unlisted.append(line)

        def on_end(self, event):
            pass

    try:
        with event.install_listener("numba:compile", Compilations()):
            yield
    finally:
        logging.root.handlers[:] = handlers
        logging.root.setLevel(level)
        for thread in threading.enumerate():
            if thread.name.endswith("(prepare)"):
                thread.join(30)
    assert not unlisted, "`python -m tools.compile_kernels --update` adds these to tools/kernels.txt"


def pytest_collection_finish() -> None:
    """Let the garbage collector run less often and skip the objects that exist now.

    These objects live until the end of the tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)

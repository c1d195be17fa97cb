"""What all tests share: reproducible property tests, and a few meshes that are built once."""

import gc
import os
from pathlib import Path

import pytest
from hypothesis import settings

from sshade.mesh.mesh import Mesh
from tests.browser import browser as browser
from tests.shapes import bumpy

# Functions of the tests' own that configurations and rows name; processes inherit it.
os.environ["EVAL_ALLOW_TARGETS"] = "eval_cases.,report_runs.,test_"

settings.register_profile("reproducible", derandomize=True, deadline=None, database=None, max_examples=25)
settings.register_profile("thorough", settings.get_profile("reproducible"), max_examples=600)
settings.load_profile("reproducible")


@pytest.fixture(scope="session")
def body() -> Mesh:
    """Closed, no symmetry, 642 vertices."""
    return bumpy(3)


@pytest.fixture(scope="session")
def small_body() -> Mesh:
    """Closed, no symmetry, 162 vertices."""
    return bumpy(2)


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A new folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def pytest_collection_finish() -> None:
    """What is there by then stays to the end: the garbage collector need not look at it again, nor often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)

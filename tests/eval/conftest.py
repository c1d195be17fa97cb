"""What tests of runs share; being here, it puts this folder's modules on the path of the tests below."""

from pathlib import Path

import pytest
from report_runs import make_runs


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Path:
    """The CSV of a small experiment; its run folders lie beside it, in runs/tiny."""
    return make_runs(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="session")
def tiny_runs(tiny) -> Path:
    """The run folders of the small experiment."""
    return tiny.parent / "runs" / "tiny"

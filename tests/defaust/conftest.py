"""One small dataset for the tests that only read."""

import shutil

import pytest

from defaust.build.dataset import build
from tests.defaust.toy import OPTIONS, Balls


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A finished dataset; do not change it."""
    out = tmp_path_factory.mktemp("data") / "balls"
    build(Balls(), out, options=OPTIONS, workers=1)
    return out


@pytest.fixture
def dataset(finished, tmp_path):
    """A copy of it to damage."""
    return shutil.copytree(finished, tmp_path / "balls")

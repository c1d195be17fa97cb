"""A small dataset, and a check of refused commands."""

import shlex
import shutil

import pytest

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.sources.synthetic import SyntheticBodies
from tests.defaust.toy import OPTIONS, Balls
from tests.robustness.case import check_refusal, run


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A finished dataset; do not change it."""
    out = tmp_path_factory.mktemp("data") / "balls"
    build(Balls(), out, options=OPTIONS, workers=1)
    return out


@pytest.fixture(scope="session")
def body(tmp_path_factory):
    """Body 4 of the package, sitting and with raised arms, remeshed; do not change it."""
    out = tmp_path_factory.mktemp("data") / "body"
    options = BuildOptions(subjects=(4,), target_vertices=8000, ls3_steps=0)
    build(SyntheticBodies(poses_used=("sitting", "arms_up")), out, options=options, workers=1)
    return out


@pytest.fixture
def dataset(finished, tmp_path):
    """A copy of the finished dataset, to be damaged."""
    return shutil.copytree(finished, tmp_path / "balls")


@pytest.fixture
def refused():
    """Assert that `defaust build` refuses arguments in one sentence that contains a message."""
    return lambda words, message: check_refusal(run(shlex.join(["defaust", "build", *words])), message)

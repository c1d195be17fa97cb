"""A small dataset, and a check of refused commands."""

import shutil

import pytest

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.cli import main
from defaust.sources.synthetic import SyntheticBodies
from tests.defaust.toy import OPTIONS, Balls


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A finished dataset; do not change it."""
    out = tmp_path_factory.mktemp("data") / "balls"
    build(Balls(), out, options=OPTIONS, workers=1)
    return out


@pytest.fixture(scope="session")
def body(tmp_path_factory):
    """Body 4 of the package, sitting and with raised arms, subdivided once and remeshed; do not change it."""
    out = tmp_path_factory.mktemp("data") / "body"
    options = BuildOptions(subjects=(4,), target_vertices=12_000, ls3_steps=1)
    build(SyntheticBodies(poses_used=("sitting", "arms_up")), out, options=options, workers=1)
    return out


@pytest.fixture
def dataset(finished, tmp_path):
    """A copy of the finished dataset, to be damaged."""
    return shutil.copytree(finished, tmp_path / "balls")


@pytest.fixture
def refused(capsys):
    """Assert that `defaust build` refuses arguments in one sentence that contains a message."""

    def check(arguments, message):
        capsys.readouterr()
        assert main(["build", *arguments]) == 2
        error = capsys.readouterr().err
        assert message in error and error.startswith("error: ") and error.count("\n") == 1

    return check

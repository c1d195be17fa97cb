"""Working folders with a dataset and with runs, which are made once and copied into each test."""

import shutil
from contextlib import chdir
from functools import cache
from pathlib import Path

from defaust.build.dataset import build
from tests.defaust.toy import OPTIONS, Balls
from tests.files import scratch
from tests.robustness.case import run

SWEEP = "sshade-eval run -m dataset=defaust dataset.root=balls subject=0 pose=1,2 method=identity"
RUN = "run dataset=defaust dataset.root=balls subject=0 pose=1 method=identity"


@cache
def _finished() -> Path:
    build(Balls(subjects=(0, 1)), scratch() / "balls of cases", options=OPTIONS, workers=1)
    return scratch() / "balls of cases"


def dataset() -> None:
    """Make a finished dataset of two balls."""
    shutil.copytree(_finished(), "balls")


@cache
def _done() -> Path:
    place = scratch() / "runs of cases"
    place.mkdir()
    with chdir(place):
        dataset()
        assert run(f"{SWEEP} run.experiment=tiny")[0] == 0
        assert run("sshade-eval collect tiny")[0] == 0
    return place


def runs() -> None:
    """Make two runs, with their dataset and their rows."""
    shutil.copytree(_done(), ".", dirs_exist_ok=True)


def cut(path: str | Path) -> None:
    """Cut a file to half of its length."""
    content = Path(path).read_bytes()
    Path(path).write_bytes(content[: len(content) // 2])

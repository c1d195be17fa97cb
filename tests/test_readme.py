"""The Python of README.md runs, and docs/experiments.md lists every experiment."""

import re
from pathlib import Path

import numpy as np

import sshade
from docs.pages import BLOCK
from eval.rows.splits import read_splits
from sshade.cli.configuration import CONFIGURATION
from tests.shapes import bumpy

ROOT = Path(__file__).parents[1]
README, LIST = ((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/experiments.md"))


def test_the_page_lists_every_experiment_with_its_split():
    (rows,) = (block["old"] for block in BLOCK.finditer(LIST) if block["name"] is None)
    listed = {
        name: half
        for line in rows.splitlines()[2:]
        for name in re.findall(r"`(\w+)`", line.split("|")[1])
        for half in [line.split("|")[2].strip()]
    }
    split = {
        path.stem: re.search(r"^  split: (\w+)$", path.read_text(), re.MULTILINE)
        for path in CONFIGURATION.glob("experiment/*.yaml")
    }
    assert listed == {name: match[1] for name, match in split.items()}
    assert set(listed.values()) <= {*read_splits(), "both"}


def test_the_python_runs(here):
    body = bumpy(3)
    sshade.write("body.ply", body)
    names: dict = {}
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert blocks
    for block in blocks:
        exec(block, names)
    leaning = sshade.read("leaning.ply").V
    assert np.abs(leaning[names["b"]] - names["bc"]).max() < 1e-6
    assert np.abs(names["shape"] - leaning).max() < 0.1 * body.diagonal

"""Give each reader up to 300 mutated inputs. Tests marked `full` try many more, mostly guided by coverage."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.fuzz.mutate import mutated
from tests.fuzz.targets import TARGETS, refused_or_read

#: Numbers of mutated inputs of slow readers. Other readers get 300.
COUNTS = {"map": 60, "yaml": 150, "shapes": 40}
#: Number of rounds of guided fuzzing, and inputs of a round. A round goes on with the inputs that earlier
#: rounds kept.
ROUNDS, EXECUTIONS = 10, 20_000
#: Maximum seconds for one input, MiB of the process, and bytes of an input.
LIMITS = ["-timeout=20", "-rss_limit_mb=4096", "-max_len=60000"]


@pytest.mark.parametrize(
    ("name", "count"),
    [
        *((name, COUNTS.get(name, 300)) for name in TARGETS),
        pytest.param("shapes", 5000, marks=pytest.mark.full),
    ],
)
def test_mutated_inputs_are_read_or_refused(name, count, tmp_path):
    target = TARGETS[name]
    seeds = target.seeds()
    assert any(refused_or_read(target, seed, tmp_path) for seed in seeds)
    read = [refused_or_read(target, mutated(seeds, target.tokens, number=k), tmp_path) for k in range(count)]
    assert 0 < sum(read) < count  # the mutations are neither all harmless nor all fatal


@pytest.mark.full
@pytest.mark.parametrize("name", [name for name in TARGETS if name != "shapes"])  # read in other processes
def test_inputs_guided_by_coverage_are_read_or_refused(name, tmp_path):
    """A crash ends the child process. Its input stays in the test's folder and appears in the output."""
    pytest.importorskip("atheris", reason="the extra fuzz is not installed")
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    memory = "/dev/shm"  # files in memory cost no disk access, if the system has this folder
    for seed in range(1, ROUNDS + 1):
        with tempfile.TemporaryDirectory(dir=memory if Path(memory).is_dir() else None) as scratch:
            command = [sys.executable, "-m", "tests.fuzz.guided", name, str(corpus), scratch, *LIMITS]
            command += [f"-atheris_runs={EXECUTIONS}", f"-seed={seed}", f"-artifact_prefix={tmp_path}/"]
            environment = os.environ | {"TMPDIR": scratch}
            done = subprocess.run(command, env=environment, stderr=-1, text=True, errors="replace")
        # The timer of libFuzzer may end the process after its work, so the exit code says nothing.
        ended = re.search(r"^Done \d+ in", done.stderr, re.MULTILINE)
        assert ended and "ERROR: libFuzzer" not in done.stderr, done.stderr[-3000:]

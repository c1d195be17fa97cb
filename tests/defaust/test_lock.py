"""One build at a time in a folder, also after a build was killed."""

import subprocess
import sys

import pytest

from defaust.build.dataset import build
from defaust.build.lock import sole_builder
from sshade import InputError
from tests.defaust.toy import KEPT, Balls

HOLD = (
    "import sys, time; from pathlib import Path; from defaust.build.lock import sole_builder\n"
    "with sole_builder(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
)


def test_a_second_builder_is_refused_until_the_first_ends_or_is_killed(tmp_path):
    out = tmp_path / "out"
    with sole_builder(out), pytest.raises(InputError, match="another process builds there; wait"):
        build(Balls(), out, options=KEPT, workers=1)
    assert not out.exists()  # nothing was built in the new folder
    with subprocess.Popen([sys.executable, "-c", HOLD, out], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="another process builds there"), sole_builder(out):
            pass
        process.kill()
    assert len(build(Balls(subjects=(0,)), out, options=KEPT, workers=1)["subjects"]) == 1

"""Commands and pages say, show and write what is recorded; ``python -m tests.record`` records anew."""

import re
import shlex
import subprocess
import sys

import pytest

from tests.full import few
from tests.record import inputs
from tests.record.compared import differences
from tests.record.transcript import COMMAND, played, recorded, transcripts

#: Transcripts that take long: each command composes a configuration, or begins a build or a run.
SLOW = {"evaluator_refusals", "evaluator_settings", "dataset_refusals", "datasets", "work_of_runs"}
#: What may stand beside the sentence of a refusal: notes, stages before it, and the recipe of a build that a
#: rerun completes, or the row of a program that failed.
BESIDE = re.compile(r"err: (note|warm-up): |\S+/\.build/recipe\.json: |\S+/row\.json: ")


@pytest.mark.parametrize("name", few(transcripts(), *(name for name in transcripts() if name not in SLOW)))
def test_commands_say_and_write_what_is_recorded(name, here):
    lines = recorded(name)
    assert not (found := differences(played(lines), lines)), "\n".join(found)


@pytest.mark.parametrize("name", transcripts())
def test_what_is_refused_is_told_in_one_sentence_and_writes_nothing(name):
    for block in "\n".join(recorded(name)).split("\n\n"):
        _, refused, said = block.partition("\nexit code 2\n")
        lines = [line for line in said.splitlines() if not BESIDE.match(line)]
        if refused:
            assert len(lines) == 1 and lines[0].startswith(("err: error: ", "err: 1 lines #")), block


def test_what_is_refused_at_once_imports_no_compiler(here):
    inputs.refused()
    lines = [shlex.split(line)[2:] for line in recorded("refusals") if line.startswith(COMMAND)]
    code = "import sys; from sshade.cli.main import main; "
    code += f"print({{main(line) for line in {lines}}}, 'numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "{2} False\n", done.stdout + done.stderr

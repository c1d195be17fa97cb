"""Programs as methods: files, failures and memory. No process of a program is left after its end."""

import os
import tracemalloc
from contextlib import nullcontext
from unittest.mock import Mock

import numpy as np
import pytest

from baselines.external import TIME_LIMIT, external
from baselines.program import ProgramFailed
from sshade import DeformationTask, Handles, InputError
from tests.eval.external_programs import TEXTS, ended, wait_for
from tests.shapes import bumpy, end_handles

#: Shell script that writes the positions of an OFF file, moved by 1 along x.
SHIFTING = (
    'n=$(sed -n 2p "$1" | cut -d" " -f1); '
    'tail -n +3 "$1" | head -n "$n" | awk "{print \\$1 + 1, \\$2, \\$3}" > "$3"'
)

#: Reports that hold what no row can hold.
WRONG = ['{"iterations": true}', '{"seconds": Infinity}', '{"converged": 1}', '{"loss": [1]}', "[1]"]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="the programs of these tests are for a shell")


@pytest.fixture
def task():
    mesh = bumpy(2)
    return DeformationTask("ends", mesh, end_handles(mesh.V, turn=np.eye(3), shift=[0, 0, 0.1]))


@pytest.fixture
def run(task, tmp_path):
    """Run the text of a shell script on the task."""

    def run(text, *words, task=task, **options):
        script = tmp_path / "program.sh"
        script.write_text(text)
        command = ["sh", str(script), *words]
        return external(task, command=command, **{**TEXTS, **options})

    return run


def test_a_program_gets_files_and_its_result_comes_back(run, task, tmp_path, capfd):
    report = '{"seconds": 0.5, "iterations": 3, "converged": true, "loss": 2}'
    result = run(f"cp \"$2\" {tmp_path}/kept.txt; echo '{report}' | tee $3.json; {SHIFTING}")
    given = np.column_stack([task.handles.index, task.handles.target])
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "kept.txt"), given)  # exactly
    np.testing.assert_allclose(result.vertices, task.mesh.V + [1, 0, 0], atol=1e-5)
    assert (result.iterations, result.converged, result.seconds["reported"]) == (3, True, 0.5)
    assert result.seconds.keys() == {"write", "program", "read", "reported"}
    assert min(result.seconds.values()) > 0 and capfd.readouterr().out == ""
    assert result.extra == {"loss": 2, "peak_mib": pytest.approx(500, abs=499)}


@pytest.mark.parametrize("form", ["ply", "obj", "off"])
def test_each_format_of_a_mesh_keeps_every_bit(run, task, form):
    options = {"mesh_format": form, "output_format": form, "handles_format": "json"}
    result = run('grep -q "\\"vertices\\"" "$2" && cp "$1" "$3"', **options)
    np.testing.assert_array_equal(result.vertices, task.mesh.V)


def test_seed_and_time_limit_reach_arguments_and_environment(run, tmp_path, monkeypatch):
    monkeypatch.setenv(TIME_LIMIT, "12.5")
    monkeypatch.setenv("EVAL_SEED", "of another run")
    told = tmp_path / "told"
    text = f'echo "$@" $EVAL_SEED $EVAL_TIME_LIMIT > {told}; set -- $4 $5 $6; {SHIFTING}'
    run(text, "seed={seed}", "{time_limit}", "{other}", "{mesh}", "{handles}", "{output}", seed=7)
    words = told.read_text().split()
    assert words[:3] == ["seed=7", "12.5", "{other}"] and words[-2:] == ["7", "12.5"]
    monkeypatch.delenv(TIME_LIMIT)
    run(text, "{seed}", "{time_limit}", "-", "{mesh}", "{handles}", "{output}")
    assert told.read_text().split()[1] == "inf"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("echo first >&2; echo 'no  end' >&2; exit 3", "exit code 3; its last line was: no end"),
        ("echo big >&2; kill -9 $$", "killed by signal 9, as the system does when memory runs out; its last"),
        ("echo done >&2", "wrote no output.txt; its last line was: done"),
        ("echo 1 2 3 > $3", "wrote 1 vertices, and the mesh has 162 vertices"),
        ("kill -15 $$", "killed by signal 15; it said nothing"),
        *((f"{SHIFTING}; echo '{text}' > $3.json", "json of the program (has|is no)") for text in WRONG),
        ("echo 1 2 x > $3", "output.txt of the program is not readable"),
        (f"{SHIFTING}; sed -i '2s/^[^ ]*/nan/; 3s/^[^ ]*/inf/' $3", "2 of the 162 vertices .* not finite"),
        (f"{SHIFTING}; echo '{{' > $3.json", "output.txt.json of the program is not JSON"),
        (f"{SHIFTING}; echo '{{\"seconds\": -1}}' > $3.json", "has seconds=-1"),
        (r"printf '\377\033[31mred\007\r\n' >&2; exit 1", r"its last line was: . \[31mred$"),
    ],
)
def test_each_failure_has_a_sentence_with_the_last_words(run, text, words):
    with pytest.raises(ProgramFailed, match=words) as failed:
        run(text)
    assert "\n" not in str(failed.value)


def test_only_the_end_of_what_a_program_says_is_read_and_repeated(run):
    peaks = []
    for _ in range(2):  # what a process allocates once counts in one of them alone
        tracemalloc.start()
        with pytest.raises(ProgramFailed) as failed:
            run("head -c 4000000 /dev/zero | tr '\\0' x >&2; exit 1")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert min(peaks) < 2e6 and len(str(failed.value)) < 400


def test_soft_handles_need_json(run, task):
    soft = DeformationTask("soft", task.mesh, Handles([0, 9], task.mesh.V[[0, 9]], weight=5.0))
    with pytest.raises(InputError, match="handles_format=txt takes no soft handles"):
        run(SHIFTING, task=soft)
    run('grep -q weight "$2" && ' + SHIFTING, task=soft, handles_format="json")


@pytest.mark.parametrize("code", [0, 1])
def test_a_program_that_ends_leaves_no_process_behind(run, tmp_path, code):
    pids = tmp_path / "pids"
    with pytest.raises(ProgramFailed) if code else nullcontext():
        run(f"{SHIFTING}; sleep 600 & echo $! $$ > {pids}; exit {code}")
    wait_for(lambda: ended(pids), seconds=10)


def test_memory_is_that_of_all_processes_together_and_all_of_them_end(run, tmp_path, monkeypatch):
    # Each process seems to take 100 MiB. Two have groups of their own. The program waits for readings.
    go, pids, seen = tmp_path / "go", tmp_path / "pids", []
    taken = lambda process: seen.append(process) or len(seen) > 3 and go.touch() or Mock(rss=100 << 20)  # noqa: E731
    monkeypatch.setattr("psutil.Process.memory_info", taken)
    started = f"S=$(command -v setsid); $S sleep 99 & $S sleep 99 & jobs -p > {pids}"
    assert run(f"{started}; until [ -e {go} ]; do sleep 0.01; done; {SHIFTING}").extra["peak_mib"] >= 300
    wait_for(lambda: ended(pids), seconds=10)

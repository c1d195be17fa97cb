"""Commands under memory limits end with one sentence and never abort. Each runs in a separate process."""

import subprocess
import sys
from pathlib import Path

import pytest

from sshade.cli.console import run_command
from sshade.cli.limits import LIBRARIES, STACKS, require_memory
from sshade.threads import available_cpus

resource = pytest.importorskip("resource")
DEFORM = ["sshade", "deform", "body.ply", "pose.json", "-o", "out.ply", "--vertices", "60"]
LEAST = LIBRARIES + STACKS * available_cpus()


def run(line: list[str], limit: int, kind: int = resource.RLIMIT_AS) -> subprocess.CompletedProcess:
    """Run a command under a limit in bytes."""
    code = (
        "import resource, runpy, sys; "
        f"resource.setrlimit({kind}, ({limit}, {limit})); "
        "sys.argv = sys.argv[1:]; runpy.run_module(sys.argv[0], run_name='__main__')"
    )
    return subprocess.run([sys.executable, "-c", code, *line], capture_output=True, text=True, timeout=100)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not enforce these limits")
@pytest.mark.parametrize("limit", [80, 150, 300, 450, 600])
def test_too_low_a_limit_is_one_sentence_before_libraries_are_imported(sound, limit):
    for kind, flag in ((resource.RLIMIT_AS, "-v"), (resource.RLIMIT_DATA, "-d")):
        done = run(DEFORM, limit * 1_000_000, kind)
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        assert done.stderr.startswith("error: there is not enough memory (this command needs up to")
        assert f"the limit is {limit} MB" in done.stderr and f"`ulimit {flag} " in done.stderr
        assert done.stderr.count("\n") == 1 and not Path("out.ply").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not enforce these limits")
def test_the_limit_that_is_asked_for_is_enough(sound):
    done = run(DEFORM, LEAST + 10_000_000)
    assert done.returncode == 0 and Path("out.ply").exists(), done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not enforce these limits")
@pytest.mark.parametrize("line", ["defaust verify body", "eval tables body", "sshade show body.ply -o a.png"])
def test_every_program_checks_the_limit(sound, line):
    done = run(line.split(), 300_000_000)
    assert done.returncode == 2 and "the limit is 300 MB" in done.stderr, done.stderr


def test_a_large_mesh_needs_more(monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (LEAST + 10_000_000, LEAST + 10_000_000))
    require_memory(vertices=1_000)
    for sizes in ({"vertices": 10**6}, {"proxy_vertices": 10**5}, {"further": 10**8}):
        with pytest.raises(MemoryError, match="this command needs up to"):
            require_memory(**sizes)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    require_memory(vertices=10**9)


def test_a_thread_that_the_system_refuses_is_one_sentence(capsys):
    def fails(words: str) -> None:
        raise RuntimeError(words)

    assert run_command(lambda: fails("can't start new thread")) == 2
    assert "there is not enough memory, or there are too many processes" in capsys.readouterr().err
    with pytest.raises(RuntimeError, match="a bug"):
        run_command(lambda: fails("a bug"))

import errno
import signal
import sys
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np
import pytest

from sshade import InputError
from sshade.cli.deform import OPTIONS, _resolved
from sshade.cli.main import PROGRAM, main
from sshade.core.console import compilation_told, mistakes_told, progress_bar
from sshade.core.whole_files import replacing
from sshade.files.meshes import read_arrays
from sshade.problem.options import described, resolve
from tests.robustness.case import run
from tests.robustness.inputs import BODY


def test_it_tells_its_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"sshade {version('sshade')}\n"


@pytest.mark.parametrize(("switch", "told"), [("--help", False), ("--help-all", True)])
def test_help_all_tells_the_rare_switches(capsys, switch, told):
    with pytest.raises(SystemExit, match="0"):
        main(["deform", switch])
    assert ("--attachment A" in capsys.readouterr().out) == told


def ended(work) -> int:
    with mistakes_told() as end:
        end.code = work()
    return end.code


def test_an_error_of_the_system_names_its_file_if_it_has_one(capsys):
    def fails(*file: str) -> None:
        raise OSError(errno.EACCES, "no", *file)

    for file in ((), ("a.ply",)):
        with mistakes_told():
            fails(*file)
    assert capsys.readouterr().err == "error: no\nerror: a.ply: no\n"


def test_each_compilation_is_told_to_who_asks():
    told: list[str] = []
    with compilation_told(told.append):
        for number in (1, 2):
            numba.njit(lambda x, number=number: x + number)(1.0)
    assert len(told) == 2


@pytest.mark.parametrize(("name", "code"), [("SIGTERM", 143), ("SIGINT", 130)])
def test_a_signal_ends_a_command_and_leaves_no_file_and_the_handlers_as_they_were(here, name, code):
    Path("a.txt").write_text("old")
    number = getattr(signal, name)

    def work() -> None:
        with replacing("a.txt") as temporary:
            temporary.write_text("half")
            signal.raise_signal(number)

    given = {signal.SIGTERM: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}[number]
    before = signal.signal(number, given)  # nohup and others ignore signals, and children inherit this
    try:
        assert ended(work) == code and signal.getsignal(number) == given
    finally:
        signal.signal(number, before)
    assert [p.name for p in here.iterdir()] == ["a.txt"] and Path("a.txt").read_text() == "old"


def test_progress_draws_a_bar_on_a_terminal_and_nothing_elsewhere(capsys, monkeypatch):
    with progress_bar() as progress:
        progress("stage", 1, 2, "note")
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar() as progress:
        progress("sampling 1", 2, 2, "residual 1e-6")
    out, err = capsys.readouterr()
    assert out == "" and "sampling 1" in err and "residual 1e-6" in err


def test_no_amount_of_the_way_writes_the_rest_shape_bit_by_bit(sound):
    for output, poses in (("out.ply", ["pose.json"]), ("out_%d.ply", ["pose.json", "pose.json"])):
        line = ["deform", "body.ply", *poses, "-o", output, "--amount", "0", "--vertices", "60"]
        assert main([*line, "--overwrite"]) == 0
    for name in ("out.ply", "out_1.ply", "out_2.ply"):
        assert np.array_equal(read_arrays(name)[0], BODY.V)


@pytest.mark.parametrize("name", OPTIONS)
def test_every_option_is_a_switch_that_reaches_the_method(name):
    """Also an option that is new."""
    option, flag = described()[name], name.replace("_", "-")
    method, changed = option.methods[-1], []
    for word in option.choices or (3, 0.3):
        switch = (f"--no-{flag}",) if option.kind == "bool" else (f"--{flag}", str(word))
        with suppress(InputError):
            line = ["a.ply", "b.json", "-o", "c.ply", "--method", method, *switch]
            given = getattr(_resolved(PROGRAM.parser("deform").parse_args(line)), name)
            changed.append(given != getattr(resolve(method, {}), name))
    assert any(changed)


@pytest.mark.parametrize("program", ["sshade show", "defaust build", "sshade-eval tables"])
def test_help_is_given_where_it_is_looked_for(program):
    name, command = program.split()
    whole, own = run(f"{name} --help"), run(f"{program} --help")
    assert whole[1] != own[1] and own[1].startswith(f"usage: {program} ")
    assert run(f"{name} help") == whole
    assert all(run(f"{name} {word} {command}") == own for word in ("help", "-h", "--help"))

import json
import os
import signal
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from sshade import DeformationTask, Handles, InputError, Mesh, deform, read_handles
from sshade.cli.main import main
from sshade.core.console import mistakes_told, progress_bar
from sshade.core.whole_files import replacing
from sshade.files.meshes import read_arrays, read_mesh, write_mesh
from sshade.files.task_files import write_handles
from tests.robustness.case import assert_refused, run
from tests.robustness.inputs import BODY, pose
from tests.shapes import beside, end_handles, rotation, shifted
from tests.sshade.mesh.test_cutting import moebius

POSE = pose(BODY.V)
DEFORM = ["deform", "body.ply", "pose.json", "-o", "out.ply"]
TURN, SHIFT = rotation(2), np.array([0.5, 0.2, 0.1])


def put_handles(*entries: dict) -> None:
    Path("pose.json").write_text(json.dumps({"handles": list(entries)}))


def test_all_options_reach_the_method(sound):
    """The options include `--weight`, which changes how handles are read."""
    options = {"vertices": 60, "start": "rest", "attachment": 0.5, "seed": 7, "workers": 2, "samplings": 2}
    line = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    write_handles("pose.json", replace(POSE, weight=np.where(POSE.dynamic, 3.0, np.inf)))
    assert main([*DEFORM, "--method", "paper", "--weight", "50", *line]) == 0
    task = DeformationTask("body", BODY, replace(POSE, weight=np.where(POSE.dynamic, 3.0, 50.0)))
    assert np.array_equal(read_arrays("out.ply")[0], deform(task, method="paper", **options).vertices)


@pytest.mark.parametrize(
    ("made", "switches", "options"),
    [
        ({"method": "paper"}, "", {"method": "paper"}),
        ({"method": "paper"}, "--no-accelerate", {"method": "paper", "accelerate": False}),
        ({"method": "paper", "samplings": 2}, "--method fine", {"method": "fine"}),
        ({"thickness": 1.0, "joints": 0.5}, "--joints 0", {"thickness": 1.0, "joints": 0}),
    ],
)
def test_options_that_the_editor_saved_apply_unless_switches_change_them(sound, made, switches, options):
    entry = {"vertices": POSE.index.tolist(), "target": POSE.target.tolist()}
    Path("pose.json").write_text(json.dumps({"handles": [entry], "made": made}))
    assert main([*DEFORM, "--vertices", "60", *switches.split()]) == 0
    V = deform(DeformationTask("body", BODY, POSE), vertices=60, **options).vertices
    assert np.array_equal(read_arrays("out.ply")[0], V)


def test_remesh_and_carry_bring_an_edit_back(sound, capsys):
    assert main(["remesh", "body.ply", "-o", "proxy.ply", "--map", "map.npz", "--vertices", "40"]) == 0
    proxy = read_mesh("proxy.ply")
    assert proxy.topology == BODY.topology
    assert {tuple(v) for v in proxy.V.tolist()} <= {tuple(v) for v in BODY.V.tolist()}
    assert f"proxy.ply: {proxy.n} vertices, {proxy.m} faces; map in map.npz" in capsys.readouterr().err
    write_mesh("edited.ply", proxy.V @ TURN.T + SHIFT, proxy.F)
    assert main(["carry", "body.ply", "map.npz", "edited.ply", "-o", "out.ply"]) == 0
    V, F = read_arrays("out.ply")
    assert np.array_equal(F, BODY.F)
    assert np.allclose(V, BODY.V @ TURN.T + SHIFT, rtol=0, atol=1e-12 * BODY.diagonal)
    assert f"{BODY.n} vertices carried by {proxy.n}" in capsys.readouterr().err
    order = np.random.default_rng(0).permutation(proxy.n)
    write_mesh("sorted.ply", proxy.V[order], np.argsort(order)[proxy.F])
    words = "sorted.ply has other edges than the proxy of map.npz: its vertices seem to be in another order"
    assert_refused("sshade", ["carry", "body.ply", "map.npz", "sorted.ply", "-o", "a.ply"], words)
    write_mesh("edited.ply", proxy.V, np.roll(proxy.F, 1, axis=1)[::-1])  # the same edges
    assert main(["carry", "body.ply", "map.npz", "edited.ply", "-o", "out.ply"]) == 0
    collapsed = proxy.V.copy()
    collapsed[proxy.F[0, 1]] = collapsed[proxy.F[0, 0]]
    write_mesh("edited.ply", collapsed, proxy.F)
    assert main(["carry", "body.ply", "map.npz", "edited.ply", "-o", "out.ply"]) == 0
    assert "note: 2 frames of the proxy have no area" in capsys.readouterr().err


def without_area() -> Mesh:
    V = np.array(BODY.V)
    V[BODY.F[100, 1]] = V[BODY.F[100, 0]]
    return Mesh(V, BODY.F)


TWO = beside(BODY, shifted(BODY, 9))
FIN = np.concatenate([BODY.F, [[*BODY.F[0, :2], BODY.n]]])  # a third face at an edge
#: Unused vertices at the beginning and at the end, faces that repeat a vertex, and a duplicate face.
V = np.concatenate([[[9.0, 9, 9]], BODY.V, [[0, 0, 0.5]]])
F = np.concatenate([[[7, 7, 9]], BODY.F + 1, BODY.F[5:6] + 1, [[3, 4, 3]]])


TURNED = np.where(np.arange(BODY.m)[:, None] % 3, BODY.F, BODY.F[:, ::-1])
BAND = moebius()


@pytest.mark.parametrize(
    ("V", "F", "handles", "options", "words"),
    [
        (BAND.V, BAND.F, end_handles(BAND.V, shift=(0, 0, 0.1)), "", "72 vertices lie on one-sided surfaces"),
        (BODY.V, TURNED, POSE, "", "107 faces were turned around, to agree with their neighbours"),
        (BODY.V, BODY.F, POSE, "--max-iterations 2", "they stopped after 2 on average"),
        (without_area().V, BODY.F, POSE, "", "2 faces without area were slightly enlarged"),
        (V[1:], FIN, POSE, "", "the surface was cut where it is not manifold: 2 vertices were"),
        (V, F, Handles(POSE.index + 1, POSE.target), "", "3 faces that repeat a vertex or another face were"),
        (V, F, Handles(POSE.index + 1, POSE.target), "", "2 vertices without a face stay in place"),
        (TWO.V, TWO.F, POSE, "", "1 component without handles follows the nearest"),
        (BODY.V, BODY.F, Handles([0, 9], BODY.V[[0, 9]] + 0.3), "", "nothing is fixed: all handles make the"),
        (BODY.V, BODY.F, Handles([0], BODY.V[[0]], dynamic=[False]), "", "no handle moves"),
    ],
)
def test_what_is_unusual_is_told(sound, capsys, V, F, handles, options, words):
    write_mesh("body.ply", V, F)
    write_handles("pose.json", handles)
    assert main([*DEFORM, "--verbose", *options.split()]) == 0
    assert words in capsys.readouterr().err


def test_a_line_judges_the_shape_and_details_that_change_little_are_one_line(sound, capsys):
    write_mesh("body.ply", V, F)
    write_handles("pose.json", Handles(POSE.index + 1, POSE.target))
    assert main(DEFORM) == 0
    lines = capsys.readouterr().err.splitlines()
    (shape,) = (line for line in lines if line.startswith("quality: "))
    assert shape.startswith("quality: largest stretch 1.") and shape.endswith("no flipped faces")
    assert "note: 2 details change little; --verbose tells more" in lines


def test_merged_positions_and_a_rotation_about_a_far_origin_are_told(sound, capsys):
    high, low = POSE.index[-1], POSE.index[0]
    source = BODY.V[[high, high]] + [[0.01, 0, 0], [-0.01, 0, 0]]
    put_handles(
        {"source": source.tolist(), "target": (source + [[0, 0.01, 0], [0, -0.01, 0]]).tolist()},
        {"vertices": [int(low)], "kind": "dynamic", "rotation": TURN.tolist()},
    )
    assert main(DEFORM) == 0
    err = capsys.readouterr().err
    assert "note: 1 position was merged with another position" in err
    assert "note: handles given by position were snapped by at most" in err
    assert "note: the rotation or scale of entry 1 is about the origin, which lies outside" in err


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


def test_an_interrupt_ends_with_130_and_an_error_of_the_program_is_not_hidden(capsys):
    closed = PermissionError(13, "Permission denied", "rows.csv")
    command = Mock(side_effect=[KeyboardInterrupt, InputError("too small"), closed, 0, ValueError("a bug")])
    assert [ended(command) for _ in range(4)] == [130, 2, 2, 0]
    said = "interrupted\nerror: too small\nerror: rows.csv: Permission denied\n"
    assert capsys.readouterr().err == said
    with pytest.raises(ValueError, match="a bug"):
        ended(command)


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


def test_an_interrupt_in_a_compiled_function_is_no_error_of_the_program(capsys):
    def fails(cause: BaseException) -> None:
        raise SystemError("returned a result with an exception set") from cause

    for cause in (KeyboardInterrupt(), SystemError()):
        cause.__cause__ = None if isinstance(cause, KeyboardInterrupt) else KeyboardInterrupt()
        assert ended(lambda cause=cause: fails(cause)) == 130
        assert capsys.readouterr().err == "interrupted\n"
    with pytest.raises(SystemError):
        ended(lambda: fails(ValueError()))


@pytest.mark.skipif(os.name == "nt", reason="needs pipes with names")
def test_inputs_and_outputs_that_are_no_files_are_named(sound):
    os.mkfifo("pipe.ply")
    os.mkdir("folder.ply")
    Path("null.ply").symlink_to("/dev/null")
    for name, words in (("pipe", "is a pipe or a device"), ("null", "is a pipe"), ("folder", "is a folder")):
        assert_refused("sshade", ["deform", f"{name}.ply", "pose.json", "-o", "out.ply"], words)
        line = ["deform", "body.ply", "pose.json", "-o", f"{name}.ply"]
        assert_refused("sshade", line, "is a folder" if name == "folder" else "is a device or a pipe")


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


def test_no_amount_of_the_way_writes_the_rest_shape_bit_by_bit(sound, capsys):
    for output, poses in (("out.ply", ["pose.json"]), ("out_%d.ply", ["pose.json", "pose.json"])):
        line = ["deform", "body.ply", *poses, "-o", output, "--amount", "0", "--vertices", "60"]
        assert main(line) == 0 and "no handle moves" not in capsys.readouterr().err
        assert main([*line, "--volume-goal", "1.1", "-o", output.replace("out", "grown")]) == 0
    for name in ("out.ply", "out_1.ply", "out_2.ply"):
        assert np.array_equal(read_arrays(name)[0], BODY.V)
        grown = read_mesh(name.replace("out", "grown"))
        assert grown.volume == pytest.approx(1.1 * BODY.volume, rel=1e-3)
    write_handles("still.json", Handles(POSE.index, BODY.V[POSE.index]))
    for more, told in (([], True), (["--volume-goal", "1.1"], False)):
        assert main(["deform", "body.ply", "still.json", "-o", "out.ply", "--vertices", "60", *more]) == 0
        assert ("no handle moves" in capsys.readouterr().err) == told
    line = ["deform", "body.ply", "pose.json", "-o", "half.ply", "--amount", "0.5", "--vertices", "60"]
    assert main(line) == 0
    mesh = Mesh(*read_arrays("body.ply"))
    half, whole = (read_handles("pose.json", mesh, amount=amount) for amount in (0.5, 1))
    assert not np.array_equal(half.target, whole.target)
    np.testing.assert_allclose(read_arrays("half.ply")[0][half.index], half.target, rtol=0, atol=1e-9)


@pytest.mark.parametrize("program", ["sshade show", "defaust build", "sshade-eval tables"])
def test_help_is_given_where_it_is_looked_for(program):
    name, command = program.split()
    whole, own = run(f"{name} --help"), run(f"{program} --help")
    assert whole[1] != own[1] and own[1].startswith(f"usage: {program} ")
    assert run(f"{name} help") == whole
    assert run(f"{name} help {command}") == run(f"{name} --help {command}") == own

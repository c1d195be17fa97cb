from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from sshade import DeformationTask, Handles, InputError, deform
from sshade.cli.console import progress_bar, run_command
from sshade.cli.main import PROGRAM, main
from sshade.io.handles import read_handles, write_handles
from sshade.io.meshes import read_arrays, read_mesh, write_mesh
from tests.shapes import bumpy, end_handles, rotation

BODY = bumpy(2)
#: The lower end held, the upper end lifted.
POSE = end_handles(BODY.V, shift=(0.3, 0, 0.2))
TURN, SHIFT = rotation(2), np.array([0.5, 0.2, 0.1])


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A folder with a sound mesh and pose, and the place of an output that does not exist yet."""
    monkeypatch.chdir(tmp_path)
    write_mesh("body.ply", BODY.V, BODY.F)
    write_handles("pose.json", POSE)
    return tmp_path


def put_handles(*entries: dict) -> None:
    Path("pose.json").write_text(json.dumps({"handles": list(entries)}))


def assert_refused(capsys, arguments: list[str], *words: str) -> None:
    """Exit code 2, one line on standard error that begins with `error:`, and no file that was not there."""
    before = {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()}
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1 and err.endswith("\n")
    for word in words:
        assert word in err
    assert {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()} == before


def test_deform_writes_the_inputs_vertices_moved_in_their_order(folder, capsys):
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply", "--vertices", "60"]) == 0
    V, F = read_arrays("out.ply")
    assert np.array_equal(F, BODY.F) and V.shape == BODY.V.shape
    gap = np.linalg.norm(V[POSE.index] - POSE.target, axis=1)
    assert gap.max() < 0.02 * BODY.diagonal
    assert np.abs(V - BODY.V).max() > 0.1
    out, err = capsys.readouterr()
    assert out == ""
    assert f"out.ply: {BODY.n} vertices, {len(POSE)} handles" in err and "a proxy of" in err
    assert sorted(p.name for p in folder.iterdir()) == ["body.ply", "out.ply", "pose.json"]


def test_deform_takes_its_options_and_is_reproducible(folder, capsys):
    base = ["deform", "body.ply", "pose.json", "--vertices", "50", "--samplings", "2"]
    for name, extra in {"a": [], "b": ["--workers", "2"], "c": ["--seed", "7"]}.items():
        assert main([*base, "-o", f"{name}.ply", *extra]) == 0
    a, b, c = (read_arrays(f"{name}.ply")[0] for name in "abc")
    assert np.array_equal(a, b) and not np.array_equal(a, c)
    assert capsys.readouterr().err.count("2 proxies of") == 3


def test_raw_takes_targets_as_they_are(folder):
    offset = [0.02, 0, 0]
    put_handles(
        {"kind": "static", "vertices": [0, 1, 2]},
        {"source": (BODY.V[[50]] + offset).tolist(), "target": (BODY.V[[50]] + [0.02, 0, 0.3]).tolist()},
    )
    for extra, x in (([], 0.0), (["--raw"], 0.02)):
        command = ["deform", "body.ply", "pose.json", "-o", "out.ply", "--vertices", "162", *extra]
        assert main([*command, "--samplings", "1"]) == 0
        gap = read_arrays("out.ply")[0][50] - BODY.V[50] - [x, 0, 0.3]
        assert np.linalg.norm(gap) < 1e-2


@pytest.mark.parametrize("method", ["fast", "paper"])
def test_iterations_that_do_not_converge_are_said(folder, capsys, method):
    command = ["deform", "body.ply", "pose.json", "-o", "out.ply", "--method", method]
    assert main([*command, "--max-iterations", "2"]) == 0
    assert "they stopped after 2 on average" in capsys.readouterr().err


@pytest.mark.parametrize("start", ["rest", "rigid", None])
@pytest.mark.parametrize("method", ["paper", "fast", "fine"])
def test_method_and_options_reach_the_solver(folder, method, start):
    command = ["deform", "body.ply", "pose.json", "-o", "out.ply", "--vertices", "60", "--method", method]
    options = {"vertices": 60, "start": start or "rigid", "attachment": 0.5}
    if method != "fine":
        options["samplings"] = 2
        command += ["--samplings", "2"]
    command += [] if start is None else ["--start", start]
    assert main([*command, "--attachment", "0.5"]) == 0
    task = DeformationTask("body", BODY, read_handles("pose.json", BODY))
    result = deform(task, method=method, **options)
    assert np.array_equal(read_arrays("out.ply")[0], result.vertices)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--method", "fine", "--samplings", "3"], ["'fine'", "no use for the option 'samplings'"]),
        (["--method", "sshade_fast"], ["'sshade_fast' is now called 'fast'"]),
        (["--method", "fsat"], ["did you mean 'fast'"]),
        (["--stiffness", "2"], ["stiffness must be a number in (0, 1], not 2"]),
    ],
)
def test_options_that_a_method_cannot_use_are_refused(folder, capsys, options, words):
    assert_refused(capsys, ["deform", "body.ply", "pose.json", "-o", "out.ply", *options], *words)


def test_repair_deforms_a_soup_and_keeps_its_vertices(folder, capsys):
    write_mesh("soup.stl", BODY.V, BODY.F)
    soup, F = read_arrays("soup.stl")
    put_handles({"source": BODY.V[POSE.index].tolist(), "target": POSE.target.tolist()})
    assert main(["deform", "soup.stl", "pose.json", "-o", "out.ply", "--repair", "--vertices", "60"]) == 0
    V, G = read_arrays("out.ply")
    assert np.array_equal(G, F) and V.shape == soup.shape
    # Corners that were at one place still are.
    _, first, inverse = np.unique(soup, axis=0, return_index=True, return_inverse=True)
    assert len(first) == BODY.n and np.array_equal(V, V[first[inverse.ravel()]])


def test_under_repair_vertex_ids_are_those_of_the_input(folder):
    """Unused vertices at the front shift every id of the repaired copy."""
    V = np.concatenate([np.full((3, 3), 9.0), BODY.V])
    write_mesh("unused.ply", V, BODY.F + 3)
    write_handles("pose.json", Handles(POSE.index + 3, POSE.target))
    assert main(["deform", "unused.ply", "pose.json", "-o", "out.ply", "--repair", "--vertices", "60"]) == 0
    moved, F = read_arrays("out.ply")
    assert np.array_equal(F, BODY.F + 3) and np.array_equal(moved[:3], V[:3])
    gap = np.linalg.norm(moved[POSE.index + 3] - POSE.target, axis=1)
    assert gap.max() < 0.02 * BODY.diagonal


def test_remesh_and_carry_bring_an_edit_back(folder, capsys):
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


def test_carry_counts_collapsed_triangles(folder, capsys):
    main(["remesh", "body.ply", "-o", "proxy.ply", "--map", "map.npz", "--vertices", "40"])
    proxy = read_mesh("proxy.ply")
    V = proxy.V.copy()
    V[proxy.F[0, 1]] = V[proxy.F[0, 0]]
    write_mesh("edited.ply", V, proxy.F)
    assert main(["carry", "body.ply", "map.npz", "edited.ply", "-o", "out.ply"]) == 0
    assert "note: 2 frames of the proxy have no area" in capsys.readouterr().err
    assert np.isfinite(read_arrays("out.ply")[0]).all()


def test_a_mesh_that_is_no_manifold_is_deformed(folder, capsys):
    V = np.concatenate([BODY.V, [[9.0, 9, 9]]])
    F = np.concatenate([BODY.F, [[*BODY.F[0, :2], BODY.n]]])  # a third face at an edge
    write_mesh("body.ply", V, F)
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply", "--vertices", "60"]) == 0
    moved, G = read_arrays("out.ply")
    assert np.array_equal(G, F) and moved.shape == V.shape and np.isfinite(moved).all()
    assert "note: the mesh is no oriented manifold" in capsys.readouterr().err
    assert np.linalg.norm(moved[POSE.index] - POSE.target, axis=1).max() < 0.02 * BODY.diagonal


def test_several_components_are_deformed_each_with_its_handles_or_carried(folder, capsys):
    write_mesh("body.ply", np.concatenate([BODY.V, BODY.V + 9]), np.concatenate([BODY.F, BODY.F + BODY.n]))
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply", "--carry-unconstrained"]) == 0
    assert "1 components without handles rigidly follow" in capsys.readouterr().err
    put_handles({"vertices": [0, BODY.n]})
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply"]) == 0
    assert "2 components were deformed separately" in capsys.readouterr().err


def test_what_is_no_surface_is_left_out_with_a_note(folder, capsys):
    """Vertices in no face, at both ends of the file, faces that repeat a vertex, and a face twice."""
    assert main(["deform", "body.ply", "pose.json", "-o", "sound.ply"]) == 0
    few = f"note: the proxy has {BODY.n // 4} vertices instead of 12000: at most a quarter"
    assert few in capsys.readouterr().err
    F = BODY.F + 1
    F = np.concatenate([[[7, 7, 9]], F, F[5:6], [[3, 4, 3]]])
    V = np.concatenate([[[9.0, 9, 9]], BODY.V, [[0, 0, 0.5]]])
    write_mesh("body.ply", V, F)
    write_handles("pose.json", Handles(POSE.index + 1, POSE.target))
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply"]) == 0
    err = capsys.readouterr().err
    assert "note: 3 faces that repeat a vertex or another face were ignored" in err
    assert "note: 2 vertices without a face stay at their places" in err
    moved, faces = read_arrays("out.ply")
    assert np.array_equal(faces, F) and np.array_equal(moved[[0, -1]], V[[0, -1]])
    assert np.array_equal(moved[1:-1], read_arrays("sound.ply")[0])
    write_handles("pose.json", Handles([0], [[1.0, 2, 3]]))
    assert_refused(capsys, ["deform", "body.ply", "pose.json", "-o", "a.ply"], "vertex 0 belongs to no face")


def test_faces_without_area_are_counted_and_the_largest_snap_is_told(folder, capsys):
    V = np.array(BODY.V)
    V[BODY.F[100, 1]] = V[BODY.F[100, 0]]
    write_mesh("body.ply", V, BODY.F)
    source = V[POSE.index] + [0.03, 0, 0.04]
    put_handles({"source": source.tolist(), "target": (source + [0.1, 0, 0]).tolist()})
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply"]) == 0
    err = capsys.readouterr().err
    assert "note: 2 faces without area were slightly enlarged" in err
    snap = read_handles("pose.json", read_mesh("body.ply")).snap_distance.max()
    share = 100 * snap / BODY.diagonal
    assert (
        f"handles given by position were snapped by at most {snap:.3g}, {share:.2g} % of the diagonal" in err
    )
    put_handles({"source": (1000 * source).tolist(), "kind": "static"})
    words = "group 0", "times 0.001 they would be on it"
    assert_refused(capsys, ["deform", "body.ply", "pose.json", "-o", "a.ply"], *words)


@pytest.mark.parametrize("command", ["deform {} {}", "remesh {} --map map.npz", "carry {} {} {}"])
def test_an_output_that_cannot_be_written_is_refused_before_any_work(folder, capsys, command):
    """A missing input would be the error, were the output not looked at first."""
    assert_refused(capsys, [*command.replace("{}", "gone.ply").split(), "-o", "no/out.ply"], "does not exist")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "a command is missing"),
        (["bend"], "'bend'"),
        (["deform", "body.ply", "pose.json"], "-o/--output; see `sshade deform --help`"),
        (["remesh", "body.ply", "-o", "a.ply", "--map", "m.npz", "--vertices", "many"], "--vertices"),
    ],
)
def test_a_mistake_in_the_arguments_is_one_sentence(folder, capsys, arguments, words):
    assert_refused(capsys, arguments, words)


def test_it_tells_its_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"sshade {version('sshade')}\n"


@pytest.mark.parametrize("command", PROGRAM.commands)
def test_help_says_what_each_command_does(capsys, command):
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0 and f"usage: sshade {command}" in capsys.readouterr().out


def test_an_interrupt_ends_with_130_and_an_error_of_the_program_is_not_hidden(capsys):
    command = Mock(side_effect=[KeyboardInterrupt, InputError("too small"), 0, ValueError("a bug")])
    assert [run_command(command) for _ in range(3)] == [130, 2, 0]
    assert capsys.readouterr().err == "interrupted\nerror: too small\n"
    with pytest.raises(ValueError, match="a bug"):
        run_command(command)


def test_progress_draws_nothing_where_there_is_no_terminal(capsys):
    with progress_bar() as progress:
        progress("stage", 1, 2, "note")
    assert capsys.readouterr() == ("", "")


def test_progress_draws_a_bar_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar() as progress:
        progress("sampling 1", 1, 2, "residual 1e-3")
        progress("sampling 1", 2, 2, "residual 1e-6")
    out, err = capsys.readouterr()
    assert out == "" and "sampling 1" in err and "residual 1e-6" in err


def test_the_package_runs_as_a_module(folder):
    run = subprocess.run(
        [sys.executable, "-m", "sshade", "remesh", "gone.ply", "-o", "a.ply", "--map", "a.npz"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2 and run.stderr == "error: gone.ply: no such file\n"

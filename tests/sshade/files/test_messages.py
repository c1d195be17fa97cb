"""Sentences about files: each names what is wrong, and count and verb agree."""

from pathlib import Path

import numpy as np
import pytest

from sshade import Handles
from sshade.core.errors import counted
from sshade.files.meshes import read_arrays, read_file, write_file, write_mesh
from sshade.files.task_files import write_handles
from tests.robustness.case import run
from tests.shapes import as_obj, beside, block, icosphere
from tests.write import off

BALL = icosphere(1)


def pose(V: np.ndarray, *ids: int) -> None:
    write_handles("pose.json", Handles(list(ids), V[list(ids)] + [[0, 0, 0.1]] + np.eye(3)[: len(ids)] * 0.1))


def inner_faces() -> tuple[np.ndarray, np.ndarray]:
    """The faces of all cubes of a block, as a mesh of a solid has them."""
    cube = block(np.ones((1, 1, 1), dtype=bool))
    parts = [cube.V + [i, j, k] for i in range(4) for j in range(4) for k in range(4)]
    V, vertex = np.unique(np.concatenate(parts), axis=0, return_inverse=True)
    F = np.concatenate([cube.F + k * cube.n for k in range(64)])
    return V, vertex.reshape(-1)[F]


def test_faces_inside_of_a_solid_are_hinted_at(here):
    V, F = inner_faces()
    write_mesh("a.ply", V, F)
    pose(V, 0, 60, 124)
    code, _, err = run("sshade deform a.ply pose.json -o out.ply")
    assert code == 0 and "more than two faces meet at an edge in most of the mesh, as faces inside" in err


@pytest.mark.parametrize("count", [1, 2])
def test_count_and_verb_agree(here, count):
    """Notes of a mesh with parts without handles, faces without area, and vertices at one place."""
    parts = beside(BALL, *[icosphere(0)] * count)
    V = np.concatenate([parts.V, [[0, 0, 9.0]] * count])
    V[BALL.n :] += [3, 0, 0]
    write_mesh("a.ply", V, np.concatenate([parts.F, parts.F[:count, [0, 0, 1]]]))
    pose(V, 0, 5, 9)
    _, _, err = run("sshade deform a.ply pose.json -o out.ply")
    for one, several in (
        ("component without handles follows", "components without handles follow"),
        ("vertex without a face stays", "vertices without a face stay"),
        ("face that repeats", "faces that repeat"),
    ):
        assert counted(count, one, several) in err


def test_bytes_behind_the_end_of_an_stl_file_stay(here):
    write_mesh("a.stl", BALL.V, BALL.F)
    rest = read_arrays("a.stl")[0]
    for further in (b"\0", b"abcd"):
        data = Path("a.stl").read_bytes()[: 84 + 50 * BALL.m] + further
        Path("a.stl").write_bytes(data)
        file = read_file("a.stl")
        assert np.array_equal(file.V, rest)
        assert file.notes == (
            f"{counted(len(further), 'byte', 'bytes')} behind its last facet, which stay in the output",
        )
        write_file("b.stl", file, file.V)
        assert Path("b.stl").read_bytes() == data


def streams() -> dict[str, bytes]:
    """Return OFF files of one mesh whose rows are no lines."""
    head, body = off(BALL.V, BALL.F).split(b"\n", 1)
    counts, rows = body.split(b"\n", 1)
    lines = rows.splitlines()
    vertices, faces = lines[: BALL.n], lines[BALL.n :]
    broken = [line.replace(b" ", b"\n", 2) for line in faces]
    return {
        "faces on several lines": b"\n".join([head, counts, *vertices, *broken]),
        "one line": b" ".join([head, counts, *lines]),
        "a number on each line": b"\n".join([head, counts, *lines]).replace(b" ", b"\r\n"),
        "counts on three lines": b"\n".join([head, counts.replace(b" ", b"\n"), *lines]),
        "comments": b"\n".join([head, b"# a ball", counts, *vertices, b"# faces", *broken]),
        "glued counts": head + counts + b"\n" + b" ".join(lines),
    }


@pytest.mark.parametrize("name", streams())
def test_off_is_a_stream_of_numbers(here, name):
    data = streams()[name]
    Path("a.off").write_bytes(data)
    file = read_file("a.off")
    assert np.array_equal(file.V, BALL.V) and np.array_equal(file.F, BALL.F)
    write_file("b.off", file, file.V)
    assert Path("b.off").read_bytes() == data
    write_file("b.off", file, file.V + 0.5)
    assert np.array_equal(read_arrays("b.off")[0], BALL.V + 0.5)
    assert len(Path("b.off").read_bytes().splitlines()) == len(data.splitlines())
    Path("a.off").write_bytes(data + b" 3")
    Path("pose.json").write_text('{"handles": [{"vertices": [0]}]}')
    code, _, err = run("sshade deform a.off pose.json -o c.ply")
    assert code == 2 and "42 vertices and 80 faces are announced" in err


def test_handles_that_contradict_their_neighbours_are_named(here):
    body = icosphere(4)
    Path("a.obj").write_text(as_obj(body.V, body.F))
    ids = np.arange(0, body.n, 10)
    target = body.V[ids] + 0.3 * np.sin(2 * body.V[ids, ::-1])
    exchanged = np.array([10, 100, 200])
    for wrong in (False, True):
        bc = target.copy()
        if wrong:
            bc[exchanged] = target[np.roll(exchanged, 1)]
        write_handles("pose.json", Handles(ids, bc))
        for method in ("fast", "interpolate") if wrong else ("fast",):
            code, _, err = run(f"sshade deform a.obj pose.json -o out.obj --method {method}")
            assert code == 0
            named = f"vertex {', '.join(map(str, ids[exchanged]))}; check the order of the targets"
            assert ("3 handles go far from where neighbours go" in err and named in err) == wrong

"""The commands write the file that they read, with other positions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sshade.cli.main import main
from sshade.io.handles import write_handles
from sshade.io.meshes import read_arrays, read_mesh, write_mesh
from sshade.task import Handles
from tests.shapes import bumpy, end_handles

BODY = bumpy(2)
POSE = end_handles(BODY.V, shift=(0.3, 0, 0.2))
#: Faces on one side of a seam have vertices of their own there, after those of the body.
BEHIND = BODY.V[BODY.F].mean(axis=1)[:, 0] > 0
SEAM = np.intersect1d(BODY.F[BEHIND], BODY.F[~BEHIND])
COPY = np.arange(BODY.n)
COPY[SEAM] = BODY.n + np.arange(len(SEAM))
V = np.concatenate([BODY.V, BODY.V[SEAM]])
F = np.where(BEHIND[:, None], COPY[BODY.F], BODY.F)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A closed body, whole and with a texture whose seam doubles vertices, and handles."""
    monkeypatch.chdir(tmp_path)
    write_mesh("whole.ply", BODY.V, BODY.F)
    lines = ["# by hand", "mtllib skin.mtl"]
    lines += [f"v {x!r} {y!r} {z!r} 0.5 0.5 0.5" for x, y, z in V.tolist()]
    lines += [f"vt {x!r} {y!r}" for x, y, _ in V.tolist()] + ["usemtl skin"]
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (F + 1).tolist()]
    Path("seam.obj").write_text("\n".join(lines) + "\n")
    write_handles("pose.json", POSE)
    return tmp_path


def test_a_seam_stays_closed_and_changes_nothing(folder, capsys):
    options = ["pose.json", "--vertices", "60"]
    assert main(["deform", "whole.ply", *options, "-o", "whole_out.ply"]) == 0
    capsys.readouterr()
    assert main(["deform", "seam.obj", *options, "-o", "out.obj"]) == 0
    said = capsys.readouterr().err
    assert (
        f"{len(SEAM)} vertices share their place with another vertex along a seam" in said
        and "loses the" not in said
    )
    moved, faces = read_arrays("out.obj")
    assert np.array_equal(moved[: BODY.n], read_mesh("whole_out.ply").V) and np.array_equal(faces, F)
    assert np.array_equal(moved[BODY.n :], moved[SEAM])
    old, new = (Path(name).read_text().splitlines() for name in ("seam.obj", "out.obj"))
    for a, b in zip(old, new, strict=True):
        assert a == b or (a[:2] == b[:2] == "v " and a.split()[4:] == b.split()[4:] == ["0.5"] * 3)


def test_handles_name_either_vertex_of_a_seam(folder):
    shift = np.array([0.3, 0, 0.2])
    low = np.argsort(BODY.V[:, 2])[:5]
    both = np.concatenate([SEAM[:2], COPY[SEAM[:2]], low])
    target = np.concatenate([V[both[:4]] + shift, BODY.V[low]])
    write_handles("pose.json", Handles(both, target))
    assert main(["deform", "seam.obj", "pose.json", "-o", "out.obj", "--vertices", "60"]) == 0
    gap = read_arrays("out.obj")[0][both] - target
    assert np.linalg.norm(gap, axis=1).max() < 0.02 * BODY.diagonal
    one = json.dumps({"handles": [{"vertices": [int(SEAM[0]), int(COPY[SEAM[0]])]}]})
    Path("pose.json").write_text(one)
    assert main(["deform", "seam.obj", "pose.json", "-o", "out.obj", "--vertices", "60"]) == 0


def test_what_the_output_cannot_hold_is_said_first(folder, capsys):
    assert main(["deform", "seam.obj", "pose.json", "-o", "out.stl", "--vertices", "60"]) == 0
    first = capsys.readouterr().err.splitlines()[0]
    assert first == (
        "note: out.stl loses the texture coordinates and vertex colours and materials and comments of "
        "seam.obj, because it has another format"
    )
    assert main(["deform", "whole.ply", "pose.json", "-o", "out.stl", "--vertices", "60"]) == 0
    assert "loses the" not in capsys.readouterr().err


def test_a_soup_is_deformed_as_the_surface_it_is(folder, capsys):
    write_mesh("soup.stl", BODY.V.astype("f4"), BODY.F)
    source = BODY.V[POSE.index].tolist()
    entry = {"source": source, "target": POSE.target.tolist()}
    Path("pose.json").write_text(json.dumps({"handles": [entry]}))
    assert main(["deform", "soup.stl", "pose.json", "-o", "out.stl", "--vertices", "60"]) == 0
    moved = read_arrays("out.stl")[0]
    _, first, inverse = np.unique(
        BODY.V[BODY.F].reshape(-1, 3), axis=0, return_index=True, return_inverse=True
    )
    assert len(first) == BODY.n and np.array_equal(moved, moved[first[inverse.ravel()]])


def test_remesh_carry_and_transfers_keep_the_file_too(folder, capsys):
    assert main(["remesh", "seam.obj", "-o", "proxy.ply", "--map", "m.npz", "--vertices", "40"]) == 0
    proxy = read_mesh("proxy.ply")
    write_mesh("edited.ply", proxy.V + [1, 2, 3], proxy.F)
    assert main(["carry", "seam.obj", "m.npz", "edited.ply", "-o", "out.obj"]) == 0
    moved, faces = read_arrays("out.obj")
    assert np.allclose(moved, V + [1, 2, 3], rtol=0, atol=1e-12) and np.array_equal(faces, F)
    assert Path("out.obj").read_text().count("vt ") == len(V)
    text = "\n".join(f"v {x!r} {y!r} {z!r}" for x, y, z in BODY.V.tolist()) + "\ns off\n"
    Path("body.obj").write_text(text + "".join(f"f {a}// {b}// {c}//\n" for a, b, c in (BODY.F + 1).tolist()))
    write_mesh("posed.ply", BODY.V[:, [1, 2, 0]], BODY.F)
    assert main(["reconstruct", "body.obj", "posed.ply", "-o", "out.obj", "--samplings", "1"]) == 0
    out = Path("out.obj").read_text()
    assert out[out.index("s off") :] == Path("body.obj").read_text()[len(text) - len("s off\n") :]
    assert np.abs(read_arrays("out.obj")[0] - BODY.V[:, [1, 2, 0]]).max() < 0.1 * BODY.diagonal


def test_a_file_is_its_own_output(folder):
    before = Path("seam.obj").read_text()
    assert main(["deform", "seam.obj", "pose.json", "-o", "seam.obj", "--vertices", "60"]) == 0
    after = Path("seam.obj").read_text()
    assert after != before and after[after.index("vt ") :] == before[before.index("vt ") :]

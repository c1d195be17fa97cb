"""Jumps of the deformation across the proxy's edges."""

import numpy as np
import pytest
from eval_cases import ends_task

from eval.main import call
from eval.studies.jumps import Jumps, close_up, compare, measure_jumps, table
from sshade import InputError, bind
from sshade.io.handles import write_handles
from sshade.io.meshes import write_mesh
from tests.shapes import bent, bumpy, rotation, strip


def test_a_fold_is_the_only_jump():
    sheet = strip(30, 6)
    cos, sin = np.cos(0.7), np.sin(0.7)
    right = np.maximum(sheet.V[:, 0] - 15, 0)
    folded = np.where(right[:, None] > 0, [15, 0, 0] + sheet.V * [0, 1, 0], sheet.V)
    folded = folded + right[:, None] * [cos, 0, sin]
    jumps = measure_jumps(sheet, folded @ rotation(1).T, binding=bind(sheet, 30))
    side = sheet.V[sheet.F].mean(axis=1)[:, 0] > 15
    across = side[jumps.pairs[:, 0]] != side[jumps.pairs[:, 1]]
    assert across.sum() == 6 and len(jumps.pairs) == (3 * sheet.m - 2 * (30 + 6)) / 2
    np.testing.assert_allclose(jumps.angle, np.where(across, np.degrees(0.7), 0.0), atol=1e-12)


def test_a_pair_crosses_where_its_vertices_follow_different_triangles_or_samples():
    mesh = bumpy(3)
    binding = bind(mesh, 60)
    jumps = measure_jumps(mesh, bent(mesh.V), binding=binding)
    follows = list(zip(binding.projection.face.tolist(), binding.sampling.cell.tolist(), strict=True))
    expected = [len({follows[v] for f in pair for v in mesh.F[f]}) > 1 for pair in jumps.pairs]
    assert jumps.crossing.tolist() == expected
    assert 0 < sum(expected) < len(expected)


def test_triangles_without_area_are_left_out():
    mesh = bumpy(2)
    V = mesh.V.copy()
    a, b, c = mesh.F[20]
    V[c] = 0.5 * (V[a] + V[b])
    jumps = measure_jumps(mesh, V, binding=bind(mesh, 40))
    assert not (jumps.pairs == 20).any() and len(jumps.pairs) == len(mesh.edges) - 3


def test_command(tmp_path, capsys, monkeypatch):
    pytest.importorskip("pyvista")
    monkeypatch.setattr("eval.studies.jumps.PANEL", 60)
    task = ends_task(bumpy(4))
    files = [str(tmp_path / "mesh.ply"), str(tmp_path / "handles.json")]
    write_mesh(files[0], task.mesh.V, task.mesh.F)
    write_handles(files[1], task.handles)
    picture = tmp_path / "close.png"
    assert call("jumps", [*files, "--vertices", "400", "-o", str(picture)]) == 0
    printed = capsys.readouterr().out
    assert table(compare(task, vertices=400)) in printed and str(picture) in printed
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_mesh_too_coarse_to_show_is_refused():
    mesh = bumpy(1)
    jumps = Jumps(np.array([[0, 1]]), np.array([30.0]), np.array([True]))
    with pytest.raises(InputError, match="too coarse to show"):
        close_up(mesh, {"a x1": (mesh.V, jumps)})

"""Formats of libraries: read, written, and read back by the libraries themselves; what is lost is said."""

import json
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh

import sshade
from sshade import InputError
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, read_file, write_file, write_mesh
from tests.robustness.working import cut
from tests.shapes import bumpy, rotation, unjoined

BODY = bumpy(2)
V, F = BODY.V + 1000 / 3, BODY.F


def by_library(path: Path) -> tuple[np.ndarray, np.ndarray]:
    if path.suffix in (".3mf", ".dae"):
        mesh = trimesh.load_scene(path, process=False).to_mesh()
        return mesh.vertices, mesh.faces
    mesh = pyvista.read(path)
    return mesh.points, mesh.cells.reshape(-1, 4)[:, 1:] if path.suffix == ".vtu" else mesh.regular_faces


def surface() -> pyvista.PolyData:
    mesh = pyvista.PolyData.from_regular_faces(V.astype(np.float32), F)
    mesh.point_data["pressure"] = np.arange(len(V))
    mesh.cell_data["label"] = np.arange(len(F))
    mesh.field_data["patient"] = [7]
    return mesh


def box() -> pyvista.UnstructuredGrid:
    """Return 3 x 3 x 3 cubes, with 8 vertices inside."""
    grid = pyvista.ImageData(dimensions=(4, 4, 4)).cast_to_unstructured_grid()
    grid.point_data["heat"] = np.arange(grid.n_points)
    return grid


@pytest.mark.parametrize("suffix", [".vtp", ".vtu", ".vtk", ".3mf"])
def test_positions_and_faces_come_back_bit_by_bit_also_by_the_library(here, suffix):
    sshade.write(f"a{suffix}", V, F)
    for found in (sshade.read(f"a{suffix}"), by_library(Path(f"a{suffix}"))):
        assert np.array_equal(found[0], V) and np.array_equal(found[1], F)
    write_file(f"b{suffix.upper()}", read_file(f"a{suffix}"), 2 * V)
    assert np.array_equal(read_arrays(f"b{suffix.upper()}")[0], 2 * V)


def test_collada_keeps_the_surface_to_seven_digits(here):
    """Each corner of a face has its own vertex."""
    sshade.write("a.dae", V, F)
    for found in (sshade.read("a.dae"), by_library(Path("a.dae"))):
        np.testing.assert_allclose(found[0][found[1]], V[F], rtol=3e-7)
    np.testing.assert_allclose(read_file("a.dae").rounding, 2**-15)


@pytest.mark.parametrize("suffix", [".vtp", ".vtk"])
def test_data_at_points_and_cells_stay_and_normals_turn(here, suffix):
    surface().compute_normals(split_vertices=False, inplace=False).save(f"a{suffix}")
    file = read_file(f"a{suffix}")
    assert file.holds == ("point data", "cell data") and not file.lost(f"b{suffix}")
    assert np.array_equal(file.rounding, np.full(3, np.spacing(np.float32(300), dtype=np.float32)))
    write_file(f"b{suffix}", file, 2 * V)
    after = pyvista.read(f"b{suffix}")
    assert np.array_equal(after.points, 2 * V) and np.array_equal(after.regular_faces, F)
    assert sorted(after.array_names) == ["Normals", "Normals", "label", "patient", "pressure"]
    assert np.array_equal(after["pressure"], np.arange(len(V))) and after["label"][-1] == len(F) - 1
    turn = rotation(1)
    write_file(f"b{suffix}", file, V @ turn.T)
    before, after = pyvista.read(f"a{suffix}"), pyvista.read(f"b{suffix}")
    for name in ("point_data", "cell_data"):
        old, new = (getattr(mesh, name).active_normals for mesh in (before, after))
        np.testing.assert_allclose(new, old @ turn.T, atol=1e-3)


def test_the_surface_of_a_volume_has_the_ids_of_the_file(here):
    box().save("a.vtu")
    file = read_file("a.vtu")
    assert np.array_equal(file.V, box().points) and len(file.F) == 108
    inside = np.setdiff1d(np.arange(64), file.F)
    assert ((file.V[inside] > 0) & (file.V[inside] < 3)).all() and len(inside) == 8
    assert file.lost("b.vtu") == ("point data", "other cells than triangles")


def test_polygons_strips_and_quadratic_cells_become_triangles(here):
    pyvista.PolyData(V[:4], lines=[2, 0, 1], faces=[4, 0, 1, 2, 3]).save("square.vtp")
    assert len(read_file("square.vtp").F) == 2 and read_file("square.vtp").V.shape == (4, 3)
    assert read_file("square.vtp").holds == ("other cells than triangles",)
    surface().strip().save("strips.vtp")
    strips = np.sort(read_file("strips.vtp").F)
    assert np.array_equal(np.unique(strips, axis=0), np.unique(np.sort(F), axis=0))
    nodes = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    kind = pyvista.CellType.QUADRATIC_TRIANGLE
    pyvista.UnstructuredGrid([6, *range(6)], [kind], nodes).save("curved.vtu")
    assert read_file("curved.vtu").F.tolist() == [[0, 1, 2]] and len(read_file("curved.vtu").V) == 6


def test_meshes_of_a_scene_stand_where_it_shows_them(here):
    scene, motion, mirror = trimesh.Scene(), np.eye(4), np.diag([-1.0, 1, 1, 1])
    motion[:3, :3], motion[:3, 3] = rotation(), [5, 0, 0]
    mesh = trimesh.Trimesh(V, F, process=False)
    places = {"a": np.eye(4), "b": motion, "c": mirror}
    for node, place in places.items():
        scene.add_geometry(mesh, geom_name="one", node_name=node, transform=place)
    scene.export("a.3mf")
    file = read_file("a.3mf")
    assert file.holds == ("objects",)
    whole = {tuple(np.round(row, 6)) for M in places.values() for row in trimesh.transform_points(V, M)}
    assert {tuple(np.round(row, 6)) for row in file.V} == whole
    parts = zip(np.split(file.V, 3), np.split(file.F, 3), strict=True)
    volumes = [sshade.Mesh(own, faces - faces.min()).volume for own, faces in parts]
    np.testing.assert_allclose(volumes, BODY.volume, rtol=1e-9)


@pytest.mark.parametrize("kind", ["body", "unused vertex", "soup"])
def test_handles_are_on_target_where_a_library_numbers_vertices_anew(here, kind, capsys):
    mesh = unjoined(BODY) if kind == "soup" else BODY
    write_mesh("a.ply", np.vstack([mesh.V, [[9, 9, 9]]]) if kind == "unused vertex" else mesh.V, mesh.F)
    low, high = (np.flatnonzero(side) for side in (mesh.V[:, 2] < -1, mesh.V[:, 2] > 1))
    entries = [{"vertices": low.tolist()}, {"vertices": high.tolist(), "translation": [0.5, 0, 0]}]
    Path("pose.json").write_text(json.dumps({"handles": entries}))
    for suffix in (".dae", ".3mf"):
        assert main(f"deform a.ply pose.json -o b{suffix} --vertices 60 --repair".split()) == 0
        said = capsys.readouterr().err
        assert " handles on target" in said and "single precision" not in said


@pytest.mark.parametrize("suffix", [".vtp", ".vtu", ".vtk", ".3mf", ".dae"])
def test_a_file_that_is_cut_or_another_is_refused_without_the_words_of_its_library(here, suffix, capfd):
    write_mesh(f"a{suffix}", V, F)
    cut(f"a{suffix}")
    Path(f"page{suffix}").write_text("<!DOCTYPE html>")
    for name in ("a", "page"):
        with pytest.raises(InputError, match=rf"not a readable {suffix[1:].upper()} file \("):
            read_file(f"{name}{suffix}")
    assert capfd.readouterr() == ("", "")

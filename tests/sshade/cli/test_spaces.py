"""Meshes and landmarks that declare LPS or RAS, as 3D Slicer writes them, are brought to one system."""

import json
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh
import vtk

import sshade
from sshade.cli.main import main
from tests.shapes import torus
from tests.write import lines, mesh_ply, obj

#: Half a turn about z maps the torus to itself, so that landmarks in the wrong system are on it, too.
BODY = torus()
V, F = BODY.V.astype(np.float32).astype(float), BODY.F
MIRROR = np.array([-1.0, -1, 1])
#: One side moves; the other side and the rest stay.
CHOSEN = np.argsort(V @ [1, 0.3, 0.1])[[0, 70, 140, 210, -1]]
MOVED = V[CHOSEN] + np.outer([0, 0, 0, 0, 1], [0.1, 0.2, 0.1])


def write_vtk(space: str, suffix: str) -> None:
    """Write a file as 3D Slicer does: legacy files have a title, XML files a field."""
    mesh = pyvista.PolyData.from_regular_faces(V, F)
    if suffix == ".vtk":
        writer = vtk.vtkPolyDataWriter()
        writer.SetHeader(f"3D Slicer output. SPACE={space}")
        writer.SetInputData(mesh)
        writer.SetFileName("mesh.vtk")
        writer.Write()
        return
    mesh.field_data["SPACE"] = [space]
    (mesh.cast_to_unstructured_grid() if suffix == ".vtu" else mesh).save(f"mesh{suffix}")


def write(space: str, suffix: str) -> Path:
    """Write the body as a file that declares a coordinate system."""
    path, title = Path(f"mesh{suffix}"), f"3D Slicer output. SPACE={space}"
    if suffix == ".ply":
        path.write_bytes(mesh_ply(V, F, "<", comments=[f"comment SPACE={space}"]))
    elif suffix == ".obj":
        path.write_bytes(lines([f"# {title}"]) + obj(V, F))
    elif suffix == ".stl":
        path.write_bytes(title.encode().ljust(80, b"\0") + trimesh.Trimesh(V, F).export(file_type="stl")[80:])
    else:
        write_vtk(space, suffix)
    return path


def markups(points: np.ndarray, space: str, name: str) -> str:
    marks = [{"label": f"p{k}", "position": point.tolist()} for k, point in enumerate(points)]
    Path(name).write_text(json.dumps({"markups": [{"coordinateSystem": space, "controlPoints": marks}]}))
    return name


@pytest.mark.parametrize("space", ["LPS", "RAS"])
@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".vtp", ".vtk", ".vtu"])
def test_the_side_that_the_landmarks_mean_moves(here, suffix, space, capsys):
    """The rest landmarks are in the system of the mesh, or in the other one; the targets are in LPS."""
    mesh = write("LPS", suffix)
    other = MIRROR if space == "RAS" else np.ones(3)
    rest = markups(V[CHOSEN] * other, space, "rest.mrk.json")
    target = markups(MOVED, "LPS", "target.mrk.json")
    assert main(["deform", str(mesh), rest, target, "-o", f"out{suffix}", "--vertices", "80"]) == 0
    said = capsys.readouterr().err
    assert ("has landmarks in RAS, and mesh" in said) == (space == "RAS")
    assert "declaration" not in said or suffix == ".vtu"
    before, after = (sshade.read(name).V for name in (mesh, f"out{suffix}"))
    for point, goal in zip(V[CHOSEN], MOVED, strict=True):
        moved = after[np.linalg.norm(before - point, axis=1) < 1e-6]  # STL has a copy for each face
        assert len(moved)
        np.testing.assert_allclose(moved, np.tile(goal, (len(moved), 1)), atol=1e-6)
    if suffix != ".vtu":  # its data are written anew, and a note says what is lost
        assert main(["deform", f"out{suffix}", rest, target, "-o", f"again{suffix}"]) == 0
        assert ("has landmarks in RAS, and out" in capsys.readouterr().err) == (space == "RAS")


@pytest.mark.parametrize("declares", ["rest", "target"])
def test_landmarks_without_a_declaration_are_in_the_system_of_the_mesh(here, declares):
    mesh, files = write("LPS", ".ply"), {"rest": V[CHOSEN], "target": MOVED}
    for name, points in files.items():
        if name == declares:
            files[name] = markups(points * MIRROR, "RAS", f"{name}.mrk.json")
        else:
            files[name] = f"{name}.csv"
            Path(files[name]).write_text("".join(f"p{k},{x},{y},{z}\n" for k, (x, y, z) in enumerate(points)))
    assert main(["deform", str(mesh), *files.values(), "-o", "out.ply", "--vertices", "80"]) == 0
    np.testing.assert_allclose(sshade.read("out.ply").V[CHOSEN], MOVED, atol=1e-6)


def test_clothes_in_the_other_system_are_on_the_body(here):
    body = write("LPS", ".ply")
    Path("shirt.obj").write_bytes(lines(["# SPACE=RAS"]) + obj(1.001 * V * MIRROR, F))
    rest, target = markups(V[CHOSEN], "LPS", "a.mrk.json"), markups(MOVED, "LPS", "b.mrk.json")
    assert main(["deform", str(body), rest, target, "-o", "out.ply", "--with", "shirt.obj"]) == 0
    np.testing.assert_allclose(sshade.read("out_shirt.obj").V * MIRROR, sshade.read("out.ply").V, atol=0.1)

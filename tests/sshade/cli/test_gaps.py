"""Notes on what a surface cannot do: parts that come apart, and triangles too long to bend."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade.cli.main import main
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from tests.shapes import beside, block, end_handles, icosphere, shifted, tube
from tests.write import obj

TUBE = tube(12, 8, length=2.0)
CHAIN = beside(*(shifted(TUBE, [0, 0, 1.7 * k]) for k in range(5)))
NAMES = ["foot", "leg", "seat", "back", "head"]


def put_pose(name: str, shift: float) -> None:
    low = {"name": "low", "kind": "fixed", "vertices": list(range(12))}
    high = {"vertices": list(range(CHAIN.n - 12, CHAIN.n)), "translation": [shift, 0, 0]}
    Path(name).write_text(json.dumps({"handles": [low, {"name": "high", **high}]}))


def write_chain(suffix: str) -> None:
    if suffix == ".ply":
        write_mesh("chain.ply", CHAIN.V, CHAIN.F)
    elif suffix == ".obj":
        text = obj(CHAIN.V, CHAIN.F).decode().splitlines()
        for k in reversed(range(5)):
            text.insert(CHAIN.n + k * TUBE.m, f"g {NAMES[k]}")
        Path("chain.obj").write_text("\n".join(text))
    else:
        scene = trimesh.Scene()
        for k, name in enumerate(NAMES):
            part = trimesh.Trimesh(shifted(TUBE, [0, 0, 1.7 * k]).V, TUBE.F, process=False)
            scene.add_geometry(part, node_name=name, geom_name=f"mesh {k}")
        scene.export("chain.glb")


@pytest.mark.parametrize(
    ("suffix", "names"),
    [
        (".ply", "the part of vertex 96 and the part of vertex 192"),
        (".obj", '"leg" (vertex 96) and "seat" (vertex 192)'),
        (".glb", '"seat" (vertex 192) and "back" (vertex 288)'),
    ],
)
def test_a_chain_of_tubes_that_overlap_reports_where_it_opens(here, suffix, names, capsys):
    write_chain(suffix)
    put_pose("pose.json", 3.0)
    put_pose("pose_2.json", 0.01)
    assert main(["deform", f"chain{suffix}", "pose.json", "-o", f"out{suffix}"]) == 0
    said = capsys.readouterr().err
    assert f"came apart by up to 24 % of the diagonal: {names}; give them common handles" in said
    assert main(["deform", f"chain{suffix}", "pose_2.json", "-o", f"out{suffix}"]) == 0
    assert "came apart" not in capsys.readouterr().err
    if suffix == ".ply":  # of all poses, the widest gap
        assert main(["deform", "chain.ply", "pose_2.json", "pose.json", "-o", "out_%d.ply"]) == 0
        assert "came apart by up to 24 %" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("mesh", "long"),
    [
        (trimesh.creation.box((1, 1, 6)), True),
        (trimesh.creation.cylinder(1, 6, sections=12), True),
        (block(np.ones((1, 1, 6)), cells=4), False),
        (tube(24, 40), False),
        (icosphere(2), False),
    ],
    ids=["box", "cylinder", "fine box", "fine tube", "ball"],
)
def test_triangles_that_are_too_long_to_bend_are_named(here, mesh, long, capsys):
    """The long sides of the box are two triangles each."""
    V, F = (mesh.vertices, mesh.faces) if long else (mesh.V, mesh.F)
    write_mesh("a.ply", V, F)
    write_handles("a.json", end_handles(V, share=0.15))
    assert main(["deform", "a.ply", "a.json", "-o", "b.ply"]) == 0
    said = capsys.readouterr().err
    assert ("a surface bends at its vertices alone: subdivide it" in said) == long

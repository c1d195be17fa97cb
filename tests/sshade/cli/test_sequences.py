"""Sequences on the command line: numbered files and morph targets."""

import weakref
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import Handles
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from sshade.method import sequence
from tests.gltf import arrays, taken_apart, with_arrays
from tests.shapes import bumpy, end_handles

BODY = bumpy(2)
ENDS = end_handles(BODY.V, share=0.1)
STEPS = (0.1, 0.15, 0.2, 0.25)
FAST = ["--vertices", "60"]
TURN = Rotation.from_rotvec([0, 0, 0.5]).as_quat().tolist()
#: What a mesh has beside its primitives, and the rotation, scale and translation of its second node.
OWN = {"name": "body", "extras": {"author": "me"}}
PLACE = {"rotation": TURN, "scale": [2, 2, 2], "translation": [9, 0, 0]}


def targets(step: float) -> np.ndarray:
    return ENDS.target + ENDS.dynamic[:, None] * np.array([step, 0.0, 0.5 * step])


@pytest.fixture
def folder(here) -> Path:
    """Write a body and four poses."""
    write_mesh("body.ply", BODY.V, BODY.F)
    for number, step in enumerate(STEPS):
        write_handles(f"pose_{number}.json", ENDS.at(targets(step)), names={0: "low", 1: "high"})
    return here


def poses(*numbers: int) -> list[str]:
    return [f"pose_{number}.json" for number in (numbers or range(len(STEPS)))]


def test_the_shapes_of_earlier_poses_are_freed(folder, monkeypatch):
    shapes, alive = [], []

    def watched(*given):
        for result in solved(*given):
            alive.append(sum(shape() is not None for shape in shapes))
            shapes.append(weakref.ref(result.vertices))
            yield result
            del result

    solved = sequence.solved_poses
    monkeypatch.setattr(sequence, "solved_poses", watched)
    assert main(["deform", "body.ply", *poses(), "-o", "out_%d.ply", *FAST]) == 0
    assert len(alive) == 4 and max(alive) <= 2


def read_gltf(path: str) -> tuple[dict, list[np.ndarray]]:
    """Read a .glb, and check that all positions have bounds."""
    tree, binary = taken_apart(Path(path).read_bytes())
    for primitive in (primitive for mesh in tree["meshes"] for primitive in mesh["primitives"]):
        for place in (primitive["attributes"], *primitive.get("targets", [])):
            assert {"min", "max"} <= tree["accessors"][place["POSITION"]].keys()
    return tree, arrays(tree, binary)


def shown_at(tree: dict, numbers: list[np.ndarray], mesh: int, name: str) -> np.ndarray:
    """Evaluate the animation at its keys: an attribute (k, n, 3) of the first primitive of a mesh."""
    animation = tree["animations"][-1]
    node = next(i for i, node in enumerate(tree["nodes"]) if node.get("mesh") == mesh)
    channel = next(c for c in animation["channels"] if c["target"] == {"node": node, "path": "weights"})
    sampler = animation["samplers"][channel["sampler"]]
    primitive = tree["meshes"][mesh]["primitives"][0]
    targets = np.array([numbers[target[name]] for target in primitive["targets"]])
    weights = numbers[sampler["output"]].reshape(-1, len(targets))
    base = numbers[primitive["attributes"][name]][:, :3]
    return base + np.einsum("kt,tni->kni", weights, targets)


def test_a_glb_has_a_morph_target_and_a_key_for_each_pose_and_keeps_what_the_mesh_has(folder):
    """Two nodes show a mesh with normals and texture coordinates. The second node turns and scales it."""
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    tree = {
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "name": "body"}, {"mesh": 0, **PLACE}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}], **OWN}],
        "materials": [{"name": "skin"}],
    }
    normals = BODY.V / np.linalg.norm(BODY.V, axis=1, keepdims=True)
    indices = BODY.F.reshape(-1, 1).astype(np.uint32)
    Path("two.glb").write_bytes(with_arrays(tree, BODY.V, normals, BODY.V[:, :2], indices))
    V = read_arrays("two.glb")[0]
    second = ENDS.index + BODY.n
    for number, step in enumerate(STEPS[:2]):
        moved = V[second] + 2 * ENDS.dynamic[:, None] * [step, 0, 0]
        index = np.concatenate([ENDS.index, second])
        target = np.concatenate([targets(step), moved])
        write_handles(f"two_{number}.json", Handles(index, target, group=np.repeat([0, 1], len(second))))
    assert main(["deform", "two.glb", "two_0.json", "two_1.json", "-o", "out.glb", *FAST, "--fps", "10"]) == 0
    assert main(["deform", "two.glb", "two_0.json", "two_1.json", "-o", "out_%d.glb", *FAST]) == 0
    tree, numbers = read_gltf("out.glb")
    sampler = tree["animations"][0]["samplers"][0]
    np.testing.assert_allclose(numbers[sampler["input"]][:, 0], [0, 0.1], atol=1e-7)
    assert tree["materials"] == [{"name": "skin"}] and len(tree["meshes"]) == 2
    for mesh in tree["meshes"]:
        assert mesh["name"] == OWN["name"] and mesh["extras"].items() >= OWN["extras"].items()
    assert all("TEXCOORD_0" in m["primitives"][0]["attributes"] for m in tree["meshes"])
    for mesh in (0, 1):
        for name in ("POSITION", "NORMAL"):
            shown = shown_at(tree, numbers, mesh, name)
            for number in (0, 1):
                one, other = read_gltf(f"out_{number + 1}.glb")
                truth = other[one["meshes"][mesh]["primitives"][0]["attributes"][name]]
                np.testing.assert_allclose(shown[number], truth, atol=2e-6)

"""Sequences on the command line: numbered files, morph targets, point caches, animations, resuming."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from sshade.cli.main import main
from sshade.io import files, gltf_morph, meshes, point_cache
from sshade.io.gltf import buffer_files
from sshade.io.handles import write_handles
from sshade.io.meshes import read_arrays, write_mesh
from sshade.mesh.mesh import Mesh
from sshade.task import Handles
from tests.gltf import arrays, buffer_beside, taken_apart, with_arrays
from tests.robustness.case import assert_refused
from tests.shapes import beside, bumpy, end_handles, tube

BODY = bumpy(2)
ENDS = end_handles(BODY.V, share=0.1)
UP = np.flatnonzero(ENDS.dynamic)
STEPS = (0.1, 0.15, 0.2, 0.25)
FAST = ["--vertices", "60"]
#: Rotation, scale and translation of the second node of a mesh.
PLACE = {
    "rotation": Rotation.from_rotvec([0, 0, 0.5]).as_quat().tolist(),
    "scale": [2, 2, 2],
    "translation": [9, 0, 0],
}


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


def vertices(name: str) -> list[np.ndarray]:
    return [read_arrays(path)[0] for path in sorted(Path().glob(name))]


def test_numbered_files_hold_the_poses_in_order(folder, capsys):
    assert main(["deform", "body.ply", *poses(), "-o", "out_%03d.ply", *FAST]) == 0
    assert sorted(p.name for p in Path().glob("out*")) == [
        *(f"out_{number:03}.ply" for number in (1, 2, 3, 4)),
        "out_sequence.json",
    ]
    for V, step in zip(vertices("out_*.ply"), STEPS, strict=True):
        np.testing.assert_allclose(V[ENDS.index], targets(step), atol=1e-12)
    assert main(["deform", "body.ply", "pose_0.json", "-o", "50%.ply", *FAST]) == 0
    assert Path("50%.ply").read_bytes() == Path("out_001.ply").read_bytes()
    assert "out_001.ply to out_004.ply: 4 poses" in capsys.readouterr().err
    assert main(["deform", "body.ply", *poses()[:2], "-o", "out_%03d.ply", *FAST]) == 0
    assert "out_003.ply is of an earlier, longer sequence, and stays" in capsys.readouterr().err


def test_the_largest_opening_of_all_poses_is_noted(folder, capsys):
    flap = Mesh(np.concatenate([BODY.V[[0, 80]], [[0, 0, 9]]]), np.array([[0, 1, 2]]))
    both = beside(BODY, flap)
    write_mesh("body.ply", both.V, both.F)
    write_handles("rest.json", ENDS.at(BODY.V[ENDS.index]), names={0: "low", 1: "high"})
    follow = ["-o", "out_%d.ply", "--carry-unconstrained", *FAST]
    assert main(["deform", "body.ply", "rest.json", "pose_3.json", *follow]) == 0
    assert "components that touched came apart by" in capsys.readouterr().err


def test_files_of_a_sequence_are_not_compared_with_each_input(folder, monkeypatch):
    assert main(["deform", "body.ply", *poses(), "-o", "out_%d.ply", *FAST]) == 0
    compared, real = [], files.is_same_file
    monkeypatch.setattr(files, "is_same_file", lambda *given: (compared.append(given), real(*given))[1])
    assert main(["deform", "body.ply", *poses(), "-o", "out_%d.ply", *FAST]) == 0
    assert len(compared) <= 1 + len(poses())


def interrupted_at_the_third_file(monkeypatch) -> list[Path]:
    """Interrupt the third call that writes a mesh; return a list that takes the path of each call."""
    write, paths = meshes.write_file, []

    def interrupted(path, file, V):
        paths.append(path)
        if len(paths) == 3:
            raise KeyboardInterrupt
        write(path, file, V)

    monkeypatch.setattr(meshes, "write_file", interrupted)
    return paths


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb", ".stl"])
def test_an_interrupted_run_goes_on_to_the_same_bytes(folder, monkeypatch, capsys, suffix):
    whole, parts = f"whole_%d{suffix}", f"parts_%d{suffix}"
    assert main(["deform", "body.ply", *poses(), "-o", whole, *FAST]) == 0
    count = interrupted_at_the_third_file(monkeypatch)
    assert main(["deform", "body.ply", *poses(), "-o", parts, *FAST]) == 130
    assert len(list(Path().glob(f"parts_?{suffix}"))) == 2
    before = Path(f"parts_1{suffix}").stat().st_mtime_ns
    assert main(["deform", "body.ply", *poses(), "-o", parts, *FAST]) == 0
    assert len(count) == 5  # three calls in the first run, two in the second
    assert "2 of them kept from an earlier run" in capsys.readouterr().err
    assert Path(f"parts_1{suffix}").stat().st_mtime_ns == before
    for number in (1, 2, 3, 4):
        assert Path(f"whole_{number}{suffix}").read_bytes() == Path(f"parts_{number}{suffix}").read_bytes()


def test_files_of_other_inputs_and_changed_files_are_computed_again(folder, monkeypatch):
    count, write = [], meshes.write_file
    monkeypatch.setattr(meshes, "write_file", lambda *given: (count.append(given[0].name), write(*given)))

    def written(*more: str) -> list[str]:
        count.clear()
        assert main(["deform", "body.ply", *poses(), "-o", "out_%d.ply", *FAST, *more]) == 0
        return count

    names = [f"out_{number}.ply" for number in (1, 2, 3, 4)]
    assert written() == names
    assert written() == []
    first = Path("out_1.ply").read_bytes()
    write_handles("pose_2.json", ENDS.at(targets(0.21)), names={0: "low", 1: "high"})
    assert written() == names[2:]
    Path("out_2.ply").write_bytes(first)  # a file of somebody else
    assert written() == names[1:]
    assert written("--seed", "1") == names
    assert written("--seed", "1", "--workers", "1") == []
    write_mesh("body.ply", BODY.V * 1.001, BODY.F)
    assert written("--seed", "1") == names
    Path("out_sequence.json").write_text("{damaged")
    assert written("--seed", "1") == names


def test_buffers_are_inputs_too(folder, capsys):
    # A .gltf with its buffer beside it.
    write_mesh("part.gltf", BODY.V, BODY.F)
    content = buffer_beside("part.gltf")
    command = ["deform", "part.gltf", *poses(0, 1), "-o", "part_%d.ply", *FAST]
    assert main(command) == 0 and main(command) == 0
    assert "2 of them kept" in capsys.readouterr().err
    smaller = (np.frombuffer(content[: 12 * BODY.n], "<f4") * np.float32(0.999)).tobytes()
    Path("part.bin").write_bytes(smaller + content[12 * BODY.n :])
    assert main(command) == 0 and "kept" not in capsys.readouterr().err
    # The bytes of a file tell whether it is binary, not its suffix.
    assert buffer_files(Path("part.gltf").rename("part.glb")) == [Path("part.bin")]
    write_mesh("whole.glb", BODY.V, BODY.F)
    assert buffer_files(Path("whole.glb").rename("whole.gltf")) == []


def test_what_a_sequence_rounds_and_where_its_handles_end_is_told_once(folder, capsys):
    far = BODY.V + [2e5, 0, 0]
    write_mesh("far.ply", far, BODY.F)
    for number in (0, 1):
        moved = Handles(ENDS.index, targets(STEPS[number]) + [2e5, 0, 0], ENDS.dynamic, ENDS.group)
        write_handles(f"far_{number}.json", moved)
    for output in ("far.pc2", "far_%d.stl"):
        assert main(["deform", "far.ply", "far_0.json", "far_1.json", "-o", output, *FAST]) == 0
        said = capsys.readouterr().err
        assert said.count("stores single precision, which moves positions by up to 0.") == 1
        assert "hard handles reached to 0." in said
    assert main(["deform", "far.ply", "far_0.json", "far_1.json", "-o", "far_%d.ply", *FAST]) == 0
    assert "single precision" not in capsys.readouterr().err


def test_options_that_the_editor_saved_are_named_where_a_sequence_does_not_use_them(folder, capsys):
    data = json.loads(Path("pose_0.json").read_text()) | {"made": {"method": "paper", "volume": 0.0}}
    Path("made.json").write_text(json.dumps(data))
    assert main(["deform", "body.ply", "made.json", "made.json", "-o", "out_%d.ply", *FAST]) == 0
    assert "made.json was saved with other values of method, volume; pass" in capsys.readouterr().err
    # The command remesh takes the options that it has.
    assert main(["remesh", "body.ply", "--options", "made.json", "-o", "p.ply", "--map", "p.npz"]) == 0


def read_pc2(path: str) -> np.ndarray:
    """Read a PC2 file: little-endian, a head of 32 bytes."""
    data = Path(path).read_bytes()
    assert data[:12] == b"POINTCACHE2\0"
    version, points, start, rate, samples = struct.unpack("<iiffi", data[12:32])
    assert (version, start, rate) == (1, 0.0, 1.0)
    return np.frombuffer(data[32:], "<f4").reshape(samples, points, 3)


def read_mdd(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Read an MDD file: big-endian, frames, points, times, positions."""
    data = Path(path).read_bytes()
    frames, points = struct.unpack(">ii", data[:8])
    numbers = np.frombuffer(data[8:], ">f4")
    return numbers[:frames], numbers[frames:].reshape(frames, points, 3)


def test_point_caches_hold_the_positions_of_the_numbered_files(folder):
    for output in ("out_%d.ply", "out.pc2", "out.mdd"):
        assert main(["deform", "body.ply", *poses(), "-o", output, *FAST, "--fps", "10"]) == 0
    V = np.array(vertices("out_*.ply"))
    np.testing.assert_allclose(read_pc2("out.pc2"), V, atol=1e-6)
    times, positions = read_mdd("out.mdd")
    np.testing.assert_allclose(times, [0, 0.1, 0.2, 0.3], atol=1e-7)
    np.testing.assert_allclose(positions, V, atol=1e-6)


def read_gltf(path: str) -> tuple[dict, list[np.ndarray]]:
    """Read a .glb and check what a validator checks: lengths, alignment, bounds, targets, animations."""
    data = Path(path).read_bytes()
    tree, binary = taken_apart(data)
    assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data)) and len(data) % 4 == 0
    size, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON" and size % 4 == 0
    assert struct.unpack("<I4s", data[20 + size : 28 + size]) == (len(binary), b"BIN\0")
    assert len(tree["buffers"]) == 1 and "uri" not in tree["buffers"][0]
    assert 0 <= len(binary) - tree["buffers"][0]["byteLength"] < 4
    numbers = arrays(tree, binary)
    for mesh in tree["meshes"]:
        counts = {len(p.get("targets", [])) for p in mesh["primitives"]}
        assert counts == {len(mesh.get("weights", []))}
        for primitive in mesh["primitives"]:
            here = tree["accessors"][primitive["attributes"]["POSITION"]]
            assert {"min", "max"} <= here.keys()
            for target in primitive.get("targets", []):
                assert target.keys() <= primitive["attributes"].keys()
                for name, number in target.items():
                    accessor = tree["accessors"][number]
                    assert (accessor["type"], accessor["count"]) == ("VEC3", here["count"])
                    assert name != "POSITION" or {"min", "max"} <= accessor.keys()
    for animation in tree.get("animations", []):
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            clock = numbers[sampler["input"]]
            assert {"min", "max"} <= tree["accessors"][sampler["input"]].keys()
            assert clock.min() >= 0 and (np.diff(clock[:, 0]) > 0).all()
            if channel["target"]["path"] == "weights":
                mesh = tree["meshes"][tree["nodes"][channel["target"]["node"]]["mesh"]]
                assert len(numbers[sampler["output"]]) == len(clock) * len(mesh["weights"])
    return tree, numbers


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


def test_a_glb_has_a_morph_target_and_a_key_for_each_pose(folder):
    for output in ("out_%d.ply", "out.glb", "out.gltf"):
        assert main(["deform", "body.ply", *poses(), "-o", output, *FAST, "--fps", "10"]) == 0
    tree, numbers = read_gltf("out.glb")
    np.testing.assert_allclose(shown_at(tree, numbers, 0, "POSITION"), vertices("out_*.ply"), atol=1e-6)
    sampler = tree["animations"][0]["samplers"][0]
    np.testing.assert_allclose(numbers[sampler["input"]][:, 0], [0, 0.1, 0.2, 0.3], atol=1e-7)
    rest = tree["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    np.testing.assert_allclose(numbers[rest], BODY.V, atol=1e-6)
    text = json.loads(Path("out.gltf").read_text())
    assert text["accessors"] == tree["accessors"] and text["meshes"] == tree["meshes"]


def test_a_glb_keeps_what_the_glb_of_the_mesh_has(folder):
    """Two nodes show a mesh with normals and texture coordinates. The second node turns and scales it."""
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    tree = {
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "name": "body"}, {"mesh": 0, **PLACE}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}]}],
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
    assert main(["deform", "two.glb", "two_0.json", "two_1.json", "-o", "out.glb", *FAST]) == 0
    assert main(["deform", "two.glb", "two_0.json", "two_1.json", "-o", "out_%d.glb", *FAST]) == 0
    tree, numbers = read_gltf("out.glb")
    assert tree["materials"] == [{"name": "skin"}] and len(tree["meshes"]) == 2
    assert all("TEXCOORD_0" in m["primitives"][0]["attributes"] for m in tree["meshes"])
    for mesh in (0, 1):
        for name in ("POSITION", "NORMAL"):
            shown = shown_at(tree, numbers, mesh, name)
            for number in (0, 1):
                one, other = read_gltf(f"out_{number + 1}.glb")
                truth = other[one["meshes"][mesh]["primitives"][0]["attributes"][name]]
                np.testing.assert_allclose(shown[number], truth, atol=2e-6)


def animation(frames: list) -> dict:
    data = json.loads(Path("pose_0.json").read_text())
    for entry in data["handles"]:
        entry.pop("target", None)
        entry.pop("kind")
    return {**data, "frames": frames}


def test_an_animation_of_handles_is_a_sequence_with_its_times(folder, capsys):
    frames = [
        {"time": t, "handles": [{"landmark": "high", "target": targets(step)[UP].tolist()}]}
        for t, step in zip((0.0, 0.5, 0.75, 2.0), STEPS, strict=True)
    ]
    Path("moves.json").write_text(json.dumps(animation(frames)))
    assert main(["deform", "body.ply", *poses(), "-o", "out_%d.ply", *FAST]) == 0
    assert main(["deform", "body.ply", "moves.json", "-o", "same_%d.ply", *FAST]) == 0
    assert main(["deform", "body.ply", "moves.json", "-o", "same.mdd", *FAST]) == 0
    np.testing.assert_array_equal(vertices("same_?.ply"), vertices("out_?.ply"))
    np.testing.assert_allclose(read_mdd("same.mdd")[0], [0.0, 0.5, 0.75, 2.0])
    assert "without their times" not in capsys.readouterr().err
    assert main(["deform", "body.ply", "moves.json", "-o", "same.pc2", *FAST]) == 0
    assert "same.pc2: 4 poses without their times, which .mdd and .glb keep" in capsys.readouterr().err


def test_frames_move_groups_rigidly_too(folder):
    quaternion = Rotation.from_rotvec([0, 0.2, 0]).as_quat()
    move = {"landmark": "high", "rotation": quaternion.tolist(), "center": "centroid"}
    move["translation"] = [0, 0, 0.1]
    data = animation([{"time": 0}, {"time": 1, "handles": [move]}])
    data["handles"][1]["kind"] = "dynamic"
    data["handles"][1]["translation"] = [0.0, 0.05, 0.0]
    Path("moves.json").write_text(json.dumps(data))
    assert main(["deform", "body.ply", "moves.json", "-o", "out_%d.ply", *FAST]) == 0
    rest = BODY.V[ENDS.index[UP]]
    first, second = (V[ENDS.index[UP]] for V in vertices("out_?.ply"))
    np.testing.assert_allclose(first, rest + [0, 0.05, 0], atol=1e-12)
    centre = rest.mean(axis=0)
    turned = Rotation.from_rotvec([0, 0.2, 0]).apply(rest - centre) + centre + [0, 0, 0.1]
    np.testing.assert_allclose(second, turned, atol=1e-12)


def rig_with(
    *, names=("root", "high", "low"), interpolation="LINEAR", channels=True, times=(0.0, 1.0)
) -> None:
    """Write a root that turns about y and a child that rises from (0, 0, 1); further nodes rest."""
    angles = np.linspace(0, 0.4, len(times))
    turns = Rotation.from_rotvec(angles[:, None] * [0, 1, 0]).as_quat()
    shifts = [0, 0, 1] + 0.2 * angles[:, None] * [0, 0, 1]
    if interpolation == "CUBICSPLINE":
        turns, shifts = (
            np.stack([0 * one, one, 0 * one], axis=1).reshape(-1, one.shape[1]) for one in (turns, shifts)
        )
    moved = [("rotation", 0), ("translation", 1)] if channels else []
    tree = {
        "nodes": [
            {"name": names[0], "children": [1]},
            {"name": names[1], "translation": [0, 0, 1]},
            *({"name": name} for name in names[2:]),
        ],
        "scenes": [{"nodes": [0]}],
        "animations": [
            {
                "name": "move",
                "channels": [
                    {"sampler": node, "target": {"node": node, "path": path}} for path, node in moved
                ],
                "samplers": [
                    {"input": 0, "output": 1 + node, "interpolation": interpolation} for _, node in moved
                ],
            }
        ],
    }
    Path("rig.glb").write_bytes(with_arrays(tree, np.array(times)[:, None], turns, shifts))
    Path("groups.json").write_text(json.dumps({"handles": animation([])["handles"]}))


def rig_motion(t: float, interpolation: str) -> tuple[np.ndarray, np.ndarray]:
    """Return R and b of the motion v -> R v + b of the child since rest, in closed form."""
    s = {"LINEAR": t, "STEP": np.floor(t), "CUBICSPLINE": 3 * t**2 - 2 * t**3}[interpolation]
    q = Rotation.from_rotvec([[0, 0, 0], [0, 0.4, 0]])
    if interpolation == "CUBICSPLINE":
        R = Rotation.from_quat((1 - s) * q[0].as_quat() + s * q[1].as_quat())
    else:
        R = Slerp([0, 1], q)(s)
    return R.as_matrix(), R.apply([0, 0, 0.2 * 0.4 * s])


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_nodes_of_a_gltf_move_the_groups_of_their_names(folder, interpolation, capsys):
    rig_with(interpolation=interpolation)
    command = ["deform", "body.ply", "groups.json", "--animation", "rig.glb", "--fps", "4", *FAST]
    assert main([*command, "-o", "out_%d.ply"]) == 0
    assert "no node of rig.glb moves low: the motion" in capsys.readouterr().err
    found = vertices("out_?.ply")
    assert len(found) == 5
    rest, still = BODY.V[ENDS.index[UP]], np.flatnonzero(~ENDS.dynamic)
    for number, V in enumerate(found):
        R, b = rig_motion(number / 4, interpolation)
        np.testing.assert_allclose(V[ENDS.index[UP]], rest @ R.T + b, atol=1e-6)
        np.testing.assert_allclose(V[ENDS.index[still]], BODY.V[ENDS.index[still]], atol=1e-12)
    assert main([*command, "-o", "out.mdd"]) == 0
    np.testing.assert_allclose(read_mdd("out.mdd")[0], [0, 0.25, 0.5, 0.75, 1])


def frames_with(*frames) -> None:
    Path("moves.json").write_text(json.dumps(animation(list(frames))))


def same_names() -> None:
    """An animation that moves a group whose name another group has."""
    frames_with({"time": 0, "handles": [{"landmark": "high", "translation": [0, 0, 1]}]})
    Path("moves.json").write_text(Path("moves.json").read_text().replace('"low"', '"high"'))


def other_mesh() -> None:
    """A pose of a larger mesh."""
    write_handles("pose_1.json", end_handles(tube(24, 60).V))


def other_groups() -> None:
    group = ENDS.group + (np.arange(len(ENDS)) == len(ENDS) - 1)
    write_handles("pose_1.json", Handles(ENDS.index, ENDS.target, group=group))


def two_groups() -> None:
    """A vertex of the group that a node moves is in the group that stays, too."""
    rig_with()
    entries = json.loads(Path("groups.json").read_text())["handles"]
    entries[0]["vertices"].append(int(ENDS.index[UP][0]))
    Path("groups.json").write_text(json.dumps({"handles": entries}))


def no_animation() -> None:
    write_mesh("rig.glb", BODY.V, BODY.F)
    rig = Path("rig.glb").read_bytes()
    rig_with()
    Path("rig.glb").write_bytes(rig)


OUT = ["-o", "out_%d.ply"]
RIG = ["groups.json", "--animation", "rig.glb", *OUT]
MOVES = ["moves.json", *OUT]
BAD = {
    "no number": (None, [*poses(), "-o", "out.ply"], "out.ply: one such file cannot hold a sequence; number"),
    "two numbers": (None, [*poses(), "-o", "o%d_%d.ply"], "one place for the number, such as out_%04d.ply"),
    "another place": (None, [*poses(), "-o", "out_%4d.ply"], "one place for the number"),
    "no place": (None, [*poses(), "-o", "50%_%s.ply"], "50%_%s.ply: one such file cannot hold a sequence"),
    "unknown format": (None, [*poses(), "-o", "out_%d.xyz"], "unknown format '.xyz'"),
    "numbered cache": (None, [*poses(), "-o", "out_%d.pc2"], "unknown format '.pc2'"),
    "fps below 0": (None, [*poses(), *OUT, "--fps", "-1"], "--fps takes a number above 0"),
    "animation as output": (
        lambda: (frames_with({"time": 0}), Path("moves.json").rename("run_sequence.json")),
        ["run_sequence.json", "-o", "run_%d.ply"],
        "run_sequence.json: is the input run_sequence.json; give another name",
    ),
    "rig as output": (
        lambda: (rig_with(), Path("rig.glb").rename("rig_1.glb")),
        ["groups.json", "--animation", "rig_1.glb", "-o", "rig_%d.glb"],
        "rig_1.glb: is the input rig_1.glb; give another name",
    ),
    "same names": (same_names, MOVES, '2 groups have the name "high"'),
    "one pose": (None, ["pose_0.json", "-o", "out.ply", "--fps", "10"], "--fps applies to sequences"),
    "other mesh": (other_mesh, [*poses(), *OUT], "pose_1.json: "),
    "other groups": (other_groups, [*poses(), *OUT], "pose_1.json: its handles have other groups"),
    "missing pose": (None, ["pose_0.json", "pose_9.json", *OUT], "pose_9.json: no such file"),
    "times": (lambda: frames_with({"time": 0.5}, {"time": 0.5}), MOVES, "its time 0.5 is not larger than"),
    "no time": (lambda: frames_with({"handles": []}), MOVES, 'frame 0: it needs a "time" in seconds'),
    "time without a number": (lambda: frames_with({"time": float("nan")}), MOVES, '"time" in seconds'),
    "times given twice": (
        lambda: frames_with({"time": 0}),
        [*MOVES, "--fps", "60"],
        "the frames of moves.json have times of their own; leave out --fps",
    ),
    "no frames": (lambda: frames_with(), MOVES, '"frames" must be a list of frames, at least one'),
    "unknown group": (
        lambda: frames_with({"time": 0, "handles": [{"landmark": "tail", "translation": [0, 0, 1]}]}),
        MOVES,
        'there is no group "tail"; the groups are low, high',
    ),
    "unknown key": (lambda: frames_with({"time": 0, "speed": 1}), MOVES, 'there is no key "speed"'),
    "two animations": (lambda: frames_with({"time": 0}), ["pose_0.json", *MOVES], "one pose is needed"),
    "no node": (lambda: rig_with(names=("a", "b")), RIG, "no node has the name of a group of handles"),
    "twice": (lambda: rig_with(names=("high", "high")), RIG, "2 nodes have the name 'high'"),
    "no channel": (lambda: rig_with(channels=False), RIG, "moves no node with the name of a group"),
    "in two groups": (two_groups, RIG, "has contradictory targets"),
    "no animation": (no_animation, RIG, "rig.glb: it holds no animation"),
    "reversed times": (lambda: rig_with(times=(1.0, 0.0)), RIG, "the times of its animation do not increase"),
    "several files": (rig_with, [*poses(), *RIG[1:]], "moves the groups of one handle file; 4 are given"),
    "mesh as rig": (rig_with, ["groups.json", "--animation", "body.ply", *RIG[3:]], "unknown format '.ply'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_a_sentence_before_anything_is_written(folder, name):
    given, arguments, words = BAD[name]
    if given is not None:
        given()
    assert_refused("sshade", ["deform", "body.ply", *arguments], words)


def test_numbered_files_never_replace_the_mesh(folder):
    Path("body.ply").rename("body_1.ply")
    line = ["deform", "body_1.ply", *poses(), "-o", "body_%d.ply", *FAST]
    assert_refused("sshade", line, "body_1.ply: is the input body_1.ply")


@pytest.mark.parametrize(
    ("output", "module", "write"),
    [("out.glb", gltf_morph, "write_morphs"), ("out.pc2", point_cache, "write_point_cache")],
)
def test_a_failing_pose_leaves_no_part_of_one_file(folder, monkeypatch, output, module, write):
    real = getattr(module, write)

    def one_alone(poses):
        yield next(poses)
        raise KeyboardInterrupt

    def failing(path, *given, **more):
        real(path, *(one_alone(one) if hasattr(one, "__next__") else one for one in given), **more)

    monkeypatch.setattr(module, write, failing)
    assert main(["deform", "body.ply", *poses(), "-o", output, *FAST]) == 130
    assert not list(Path().glob("*out*"))


def test_a_glb_that_would_be_too_large_is_refused(folder, monkeypatch):
    monkeypatch.setattr(gltf_morph, "LARGEST", 10_000)
    line = ["deform", "body.ply", *poses(), "-o", "out.glb", *FAST]
    assert_refused("sshade", line, "4 poses take 0.0 GB, and a glTF file holds")

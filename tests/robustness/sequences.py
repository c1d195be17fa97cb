"""Cases: sequences of poses, and poses that drive another mesh."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from sshade.io.handles import write_handles
from sshade.io.meshes import read_arrays, write_mesh
from tests.robustness.case import Case, nothing, on_a_full_disk, refused, run
from tests.robustness.inputs import BODY, Given, both, data, garbage, pose
from tests.shapes import bumpy

POSES = "sshade deform body.ply pose.json more.json -o {} --vertices 60"
FRAMES = "sshade deform body.ply frames.json -o out_%d.ply --vertices 60"
NODES = "sshade deform body.ply pose.json --animation rig.glb -o out_%d.ply --vertices 60"
MARKS = "sshade transfer-pose body.ply poses other.ply --marks marks.json -o out_%d.ply"


def more() -> None:
    """A second pose."""
    handles = pose(BODY.V)
    moved = handles.target + handles.dynamic[:, None] * np.array([0.02, 0.01, 0.0])
    write_handles("more.json", handles.at(moved))


def frames(*times: Any) -> Given:
    """An animation with frames at some times."""

    def write() -> None:
        given = json.loads(Path("pose.json").read_text())
        given["frames"] = [{"time": time} for time in times]
        Path("frames.json").write_text(json.dumps(given))

    return write


def driven() -> None:
    """Two poses of the body, another mesh, and marks."""
    other = bumpy(3)
    write_mesh("other.ply", other.V, other.F)
    Path("poses").mkdir()
    for number in (1, 2):
        write_mesh(f"poses/{number}.ply", BODY.V + [0.1 * number, 0, 0], BODY.F)
    marks = [{"source": i, "target": BODY.V[i].tolist()} for i in range(0, BODY.n, 8)]
    Path("marks.json").write_text(json.dumps({"marks": marks}))


def _short() -> None:
    write_mesh("poses/2.ply", BODY.V[:3], [[0, 1, 2]])


def _other_handles() -> None:
    handles = pose(BODY.V)
    write_handles("more.json", type(handles)(handles.index[:4], handles.target[:4]))


def _rig(content: bytes) -> Given:
    return data("rig.glb", content)


REFUSED = {
    POSES.format("out_%d.ply"): {
        "poses with other handles": (_other_handles, "more.json", "first pose", "all poses of a sequence"),
        "a pose that is garbage": (garbage("more.json"), "more.json", "not readable as JSON"),
        "a pose that is an animation": (
            both(frames(0), lambda: Path("frames.json").rename("more.json")),
            "more.json: it holds an animation",
        ),
    },
    POSES.format("out.ply"): {"poses without a number in the output": (more, "out_%04d.ply", ".pc2 or .mdd")},
    POSES.format("out_%s.ply"): {"poses with another pattern": (more, "one place for the number")},
    FRAMES: {
        "frames without frames": (frames(), "at least one"),
        "frames whose times fall": (frames(1, 0.5), "frame 1", "not larger than the time before"),
        "frames with a time that is NaN": (frames(float("nan")), "frame 0", '"time" in seconds'),
        "frames with a time that is a text": (frames("now"), "frame 0", '"time" in seconds'),
    },
    NODES: {
        "nodes of a file that is missing": (nothing, "rig.glb: no such file"),
        "nodes of garbage": (garbage("rig.glb"), "rig.glb"),
        "nodes of a mesh without animation": (
            lambda: write_mesh("rig.glb", BODY.V, BODY.F),
            "rig.glb: it holds no animation",
        ),
        "nodes of a cut file": (_rig(b"glTF\x02\0\0\0\xff\0\0\0"), "not a readable GLB file"),
    },
    MARKS: {
        "driving poses of another mesh": (both(driven, _short), "poses/2.ply has 3 vertices"),
        "marks that are garbage": (both(driven, garbage("marks.json")), "marks.json: not readable as JSON"),
        "marks without a list": (both(driven, data("marks.json", b"{}")), 'a list "marks"'),
        "too few marks": (
            both(driven, data("marks.json", b'{"marks": [{"source": 1, "target": 1}]}')),
            "1 marks are given, and at least 4 are needed",
        ),
    },
}


def _one_for_each() -> None:
    first, second = (read_arrays(f"out_{number}.ply")[0] for number in (1, 2))
    assert run("sshade deform body.ply pose.json -o single.ply --vertices 60")[0] == 0
    assert np.array_equal(first, read_arrays("single.ply")[0]) and not np.array_equal(first, second)


def _translated() -> None:
    rest = read_arrays("other.ply")[0]
    for number in (1, 2):
        moved = read_arrays(f"out_{number}.ply")[0]
        np.testing.assert_allclose(moved, rest + [0.1 * number, 0, 0], atol=1e-3)


def _again() -> None:
    """An earlier run whose second file was damaged."""
    more()
    assert run(POSES.format("out_%d.ply"))[0] == 0
    Path("out_2.ply").write_bytes(b"damaged")


NUMBERED = ("out_1.ply", "out_2.ply", "out_sequence.json")

CASES = [
    *(case for call, table in REFUSED.items() for case in refused(call, table)),
    Case(
        "two poses",
        POSES.format("out_%d.ply"),
        more,
        leaves=(*NUMBERED, "single.ply"),
        holds=_one_for_each,
    ),
    Case(
        "two poses, the second file damaged since",
        POSES.format("out_%d.ply"),
        _again,
        leaves=("out_2.ply", "out_sequence.json", "single.ply"),
        holds=_one_for_each,
    ),
    Case("a translation drives another mesh", MARKS, driven, leaves=NUMBERED, holds=_translated),
    *(on_a_full_disk(POSES.format(f"out.{suffix}"), more) for suffix in ("glb", "pc2", "mdd")),
]

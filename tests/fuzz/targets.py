"""What is fuzzed: each target reads bytes as a file, and may only raise InputError."""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from defaust.folder.record import read_dataset, read_json
from defaust.sources.files import SourceShape, find_shapes
from eval.rows.frame import read_csv
from eval.rows.store import read_row
from sshade import InputError, Mesh
from sshade.files.meshes import SUFFIXES, read_mesh, write_mesh
from sshade.files.task_files import read_handles
from tests.files import scratch
from tests.gltf import glb
from tests.shapes import bumpy, icosphere
from tests.sshade.files.test_formats import OBJ, OFF, STL
from tests.sshade.files.test_gltf import instanced
from tests.sshade.files.test_ply import OLD_MESHLAB, ply

#: A sound mesh for handles and maps.
BODY = bumpy(1)


@dataclass(frozen=True)
class Target:
    """A reader.

    Parameters
    ----------
    read : callable
        Takes the bytes and a folder to put them in.
    seeds : callable
        Sound inputs, for mutations to begin with.
    tokens : tuple of bytes
        Words of the format, to be put into inputs.
    """

    read: Callable[[bytes, Path], Any]
    seeds: Callable[[], list[bytes]]
    tokens: tuple[bytes, ...]


def refused_or_read(target: Target, data: bytes, folder: Path) -> bool:
    """Whether the bytes were read; anything but an InputError comes through."""
    try:
        target.read(data, folder)
    except InputError as error:
        assert "\n" not in str(error), f"more than a line: {error!r}"
        return False
    return True


def _put(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _read_mesh(data: bytes, folder: Path) -> None:
    """The first byte chooses the format."""
    suffix = SUFFIXES[data[0] % len(SUFFIXES)] if data else ".ply"
    read_mesh(_put(folder, f"mesh{suffix}", data[1:]))


def _mesh_seeds() -> list[bytes]:
    seeds = []
    sphere = icosphere(0)
    folder = scratch()
    for number, suffix in enumerate(SUFFIXES):
        write_mesh(folder / f"seed{suffix}", sphere.V, sphere.F)
        seeds.append(bytes([number]) + (folder / f"seed{suffix}").read_bytes())
    orders = ("ascii", "binary_little_endian", "binary_big_endian")
    contents = [(".ply", ply(order)) for order in orders]
    contents += [(".obj", OBJ.encode()), (".off", OFF.encode()), (".stl", (STL + STL).encode())]
    contents += [(".ply", OLD_MESHLAB.encode()), (".glb", glb(*instanced()))]
    seeds += [bytes([SUFFIXES.index(suffix)]) + content for suffix, content in contents]
    return seeds


def _read_json_handles(data: bytes, folder: Path) -> None:
    read_handles(_put(folder, "pose.json", data), BODY)


def _read_yaml_handles(data: bytes, folder: Path) -> None:
    """Up to two zero bytes divide the YAML from the points of its part and of its transform."""
    parts = (data.split(b"\0", 2) + [b"", b""])[:3]
    for name, content in zip(("parts/a.txt", "transforms/b.txt"), parts[1:], strict=True):
        (folder / name).parent.mkdir(exist_ok=True)
        _put(folder, name, content)
    read_handles(_put(folder, "pose.yaml", parts[0]), BODY)


def _json_seeds() -> list[bytes]:
    V = BODY.V.round(3).tolist()
    entries = [
        {"landmark": "a", "kind": "static", "vertices": [0, 1, 2]},
        {"kind": "dynamic", "vertices": [3], "target": [[1, 2, 3]]},
        {"kind": "dynamic", "source": V[5:8], "target": V[6:9]},
        {"kind": "unused"},
        {"vertices": [8, 9], "rotation": [0, 0, 0, 1], "center": "centroid"},
        {"boxes": [[[-9, -9, -9], [9, 9, 9]]], "translation": [0, 0, 1]},
    ]
    return [json.dumps({"handles": entries[:k]}).encode() for k in range(1, len(entries) + 1)]


def _yaml_seeds() -> list[bytes]:
    points = b"\n".join(b"%g %g %g" % tuple(p) for p in BODY.V[:3] * 0.3)
    text = b"handles:\n  static: {positions: [a]}\n  moving:\n    positions: [a]\n    transform: [b]\n"
    return [text + b"\0" + points + b"\0" + points, b"handles: {static: {positions: [a]}}\0" + points]


def _read_manifest(data: bytes, folder: Path) -> None:
    """The first byte chooses dataset.json, a pose file, a row or a table of rows."""
    kind, content = (data[0] % 4, data[1:]) if data else (0, data)
    if kind == 0:
        _put(folder, "dataset.json", content)
        read_dataset(folder, intact=False)
    elif kind == 1:
        read_json(_put(folder, "pose.json", content))
    elif kind == 2:
        _put(folder, "row.json", content)
        read_row(folder)
    else:
        read_csv(_put(folder, "rows.csv", content))


def _manifest_seeds() -> list[bytes]:
    from defaust.build.dataset import build
    from eval.rows.frame import to_frame, write_csv
    from tests.defaust.toy import OPTIONS, Balls

    out = scratch() / "balls"
    build(Balls(subjects=(0,)), out, options=OPTIONS, workers=1)
    row = {"task.name": "t", "method.name": "m", "method.hash": "h", "seed": 0, "status": "ok", "key": "k"}
    row |= {"date": "2026-01-01", "env.machine": "box", "metric.edge": 1.5, "seconds.total": 2.0}
    write_csv(out / "rows.csv", to_frame([row, row | {"seed": 1}]))
    contents = [(out / "dataset.json").read_bytes(), (out / "subject_00/pose_1.json").read_bytes()]
    contents += [json.dumps(row).encode(), (out / "rows.csv").read_bytes()]
    return [bytes([kind]) + content for kind, content in enumerate(contents)]


def _read_shapes(data: bytes, folder: Path) -> None:
    """The first byte chooses the format; a table of numbers has a sound second file beside it."""
    suffixes = (".mat", ".npz", ".vert", ".tri")
    suffix, content = (suffixes[data[0] % 4], data[1:]) if data else (".mat", data)
    if suffix in (".vert", ".tri"):
        ball = icosphere(0)
        np.savetxt(folder / "a.vert", ball.V, fmt="%.9g")
        np.savetxt(folder / "a.tri", ball.F + 1, fmt="%d")
    path = _put(folder, f"a{suffix}", content)
    if suffix == ".npz":
        for shapes in find_shapes(path, layout="auto")[0].values():
            for shape in shapes:
                Mesh(*shape.arrays())
    else:
        Mesh(*SourceShape("a", path.with_suffix(".mat" if suffix == ".mat" else ".vert")).arrays())


def _shape_seeds() -> list[bytes]:
    from scipy.io import savemat

    ball, seeds = icosphere(0), []
    surface = {"X": ball.V[:, :1], "Y": ball.V[:, 1:2], "Z": ball.V[:, 2:], "TRIV": (ball.F + 1).astype("u2")}
    poses = {"V_0": ball.V, "V_1": 2 * ball.V, "F": ball.F}
    writers = (
        (b"\0", lambda file: savemat(file, {"surface": surface})),
        (b"\0", lambda file: savemat(file, {"surface": surface}, do_compression=True)),
        (b"\1", lambda file: np.savez(file, **poses)),
        (b"\1", lambda file: np.savez_compressed(file, **poses)),
        (b"\2", lambda file: np.savetxt(file, ball.V, fmt="%.9g")),
        (b"\3", lambda file: np.savetxt(file, ball.F + 1, fmt="%d")),
    )
    for kind, write in writers:
        buffer = io.BytesIO()
        write(buffer)
        seeds.append(kind + buffer.getvalue())
    return seeds


NUMBERS = b"nan inf 1e999 -1 0 99999999999999999999 1e-320 0x10 true null".split()
_MESH = (
    b"v;vt;f;solid;endsolid;facet;vertex;endloop;OFF;COFF;ply;format ascii 1.0;end_header;element vertex ;\n"
)
_MESH += b";format binary_little_endian 1.0;element face ;property list uchar int vertex_indices"
_MESH += b";property list int int vertex_index"
_JSON = [*b'"handles" "vertices" "source" "target" "kind" "static" [] {} [['.split(), b"[" * 99]
_YAML = b"handles: static: moving: positions: transform: &a *a !!python/object: ../ <<: {a: [".split()
_MANIFEST = [*b'"files" "format" status ../ "subjects" "poses"'.split(), *_JSON]

TARGETS = {
    "mesh": Target(_read_mesh, _mesh_seeds, (*_MESH.split(b";"), *NUMBERS)),
    "handles": Target(_read_json_handles, _json_seeds, (*_JSON, *NUMBERS)),
    "yaml": Target(_read_yaml_handles, _yaml_seeds, (*_YAML, *NUMBERS)),
    "manifest": Target(_read_manifest, _manifest_seeds, (*_MANIFEST, *NUMBERS)),
    "shapes": Target(_read_shapes, _shape_seeds, tuple(NUMBERS)),
}

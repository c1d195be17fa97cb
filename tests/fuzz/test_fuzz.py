"""One property of every parser: it reads bytes mutated at random, or refuses them in one sentence."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.folder.record import read_dataset, read_json
from defaust.sources.files import SourceShape
from eval.rows.frame import read_csv, to_frame, write_csv
from eval.rows.store import read_row
from sshade import InputError, Mesh
from sshade.files.mesh_file import SUFFIXES
from sshade.files.meshes import read_mesh, write_mesh
from sshade.files.task_files import read_handles
from tests.defaust.toy import OPTIONS, Balls
from tests.files import sample
from tests.gltf import glb
from tests.shapes import bumpy, icosphere
from tests.sshade.files.test_gltf import instanced
from tests.sshade.files.test_ply import mixed

BODY, BALL = bumpy(1), icosphere(0)
MUTATIONS = 400
NUMBERS = b"nan inf 1e999 -1 0 99999999999999999999 1e-320 0x10 true null".split()
MESH = b"v;vt;f;solid;endsolid;facet;vertex;endloop;OFF;COFF;ply;format ascii 1.0;end_header".split(b";")
MESH += b"element vertex ;element face ;property list uchar int vertex_indices;property list int int ".split(
    b";"
)
JSON = [
    *b'"handles" "vertices" "source" "target" "kind" "static" "files" "format" ../ [] {} [['.split(),
    b"[" * 99,
]
#: Further files of a dataset, and rows and tables of rows.
RECORDS = ("dataset.json", "pose.json", "row.json", "rows.csv")


@dataclass(frozen=True)
class Parser:
    """A reader of files, sound files for mutations to begin with, and words of the formats.

    Parameters
    ----------
    read : callable
        Takes the name of a file in the working folder.
    seeds : callable
        Yields names and sound contents.
    tokens : list of bytes
    """

    read: Callable[[str], Any]
    seeds: Callable[[], Iterator[tuple[str, bytes]]]
    tokens: list[bytes]


def meshes() -> Iterator[tuple[str, bytes]]:
    for suffix in SUFFIXES:
        write_mesh(f"seed{suffix}", BALL.V, BALL.F)
        yield f"mesh{suffix}", Path(f"seed{suffix}").read_bytes()
    for name in ("studio.obj", "colours.off", "two_facets.stl", "old_meshlab.ply"):
        yield f"mesh{Path(name).suffix}", sample(name).encode()
    for order in ("", "<", ">"):
        yield "mesh.ply", mixed(order)
    yield "mesh.glb", glb(*instanced())


def handles() -> Iterator[tuple[str, bytes]]:
    V = BODY.V.tolist()
    entries = [
        {"landmark": "a", "kind": "static", "vertices": [0, 1, 2]},
        {"kind": "dynamic", "source": V[5:8], "target": V[6:9]},
        {"kind": "unused"},
        {"vertices": [8, 9], "rotation": [0, 0, 0, 1], "center": "centroid"},
        {"boxes": [[V[12], V[12]]], "translation": [0, 0, 1]},
    ]
    for k in range(1, len(entries) + 1):
        yield "pose.json", json.dumps({"handles": entries[:k]}).encode()


def records() -> Iterator[tuple[str, bytes]]:
    build(Balls(subjects=(0,)), Path("balls"), options=OPTIONS, workers=1)
    row = {"task.name": "t", "method.name": "m", "method.hash": "h", "seed": 0, "status": "ok", "key": "k"}
    row |= {"date": "2026-01-01", "env.machine": "box", "metric.edge": 1.5, "seconds.total": 2.0}
    write_csv(Path("balls/rows.csv"), to_frame([row, row | {"seed": 1}]))
    Path("balls/row.json").write_text(json.dumps(row))
    for name, path in zip(
        RECORDS, ("dataset.json", "subject_00/pose_1.json", "row.json", "rows.csv"), strict=True
    ):
        yield name, Path("balls", path).read_bytes()


def read_record(name: str) -> None:
    if name == "dataset.json":
        read_dataset(Path(), intact=False)
    elif name == "pose.json":
        read_json(Path(name))
    elif name == "row.json":
        read_row(Path())
    else:
        read_csv(Path(name))


def shapes() -> Iterator[tuple[str, bytes]]:
    """The coordinates of a table have a sound file of triangles beside them, and the other way."""
    np.savetxt("vert.vert", BALL.V, fmt="%.9g")
    np.savetxt("tri.tri", BALL.F + 1, fmt="%d")
    for own, other in ("tri.vert", "vert.vert"), ("vert.tri", "tri.tri"):
        Path(own).write_bytes(Path(other).read_bytes())
    yield "vert.vert", Path("vert.vert").read_bytes()
    yield "tri.tri", Path("tri.tri").read_bytes()


def read_shapes(name: str) -> None:
    Mesh(*SourceShape("a", Path(name).with_suffix(".vert")).arrays())


PARSERS = {
    "mesh": Parser(read_mesh, meshes, MESH + NUMBERS),
    "handles": Parser(lambda name: read_handles(name, BODY), handles, JSON + NUMBERS),
    "records": Parser(read_record, records, JSON + NUMBERS),
    "shapes": Parser(read_shapes, shapes, NUMBERS),
}


def mutated(data: bytes, seeds: list[bytes], tokens: list[bytes], rng: np.random.Generator) -> bytes:
    """Return bytes with one or two random changes; seeds and tokens lend parts."""
    for _ in range(int(rng.integers(1, 3))):
        at = int(rng.integers(len(data) + 1))
        end = min(len(data), at + int(rng.geometric(0.2)))
        other, token = (parts[int(rng.integers(len(parts)))] for parts in (seeds, tokens))
        start = int(rng.integers(len(other) + 1))
        part = other[start : start + int(rng.geometric(0.02))]
        new = [rng.bytes(end - at), b"", 2 * data[at:end], token, token + data[at:end], part][rng.integers(6)]
        data = data[:at] + new + (data[end:] if rng.random() < 0.97 else b"")
    return data


def is_read(parser: Parser, name: str, data: bytes) -> bool:
    """Whether a file was read; anything but an InputError of one line comes through."""
    Path(name).write_bytes(data)
    try:
        parser.read(name)
    except InputError as error:
        assert "\n" not in str(error), f"more than a line: {error!r}"
        return False
    return True


@pytest.mark.parametrize("name", PARSERS)
def test_mutated_inputs_are_read_or_refused(here, name):
    parser, rng = PARSERS[name], np.random.default_rng(0)
    seeds = list(parser.seeds())
    assert all(is_read(parser, *seed) for seed in seeds)
    contents, read = [content for _, content in seeds], 0
    for number in range(MUTATIONS):
        file, content = seeds[number % len(seeds)]
        read += is_read(parser, file, mutated(content, contents, parser.tokens, rng))
    assert 0 < read < MUTATIONS  # the mutations are neither all harmless nor all fatal

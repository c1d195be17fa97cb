"""One property of every parser: it reads bytes mutated at random, or refuses them in one sentence."""

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.folder.record import read_dataset
from defaust.sources.files import SourceShape
from eval.rows.frame import read_csv, to_frame, write_csv
from eval.rows.store import read_row
from sshade import InputError, Mesh, read_handles
from sshade.files.mesh_file import SUFFIXES
from sshade.files.meshes import read_mesh, write_mesh
from tests.defaust.toy import OPTIONS, Balls
from tests.files import sample
from tests.gltf import glb
from tests.shapes import bumpy, icosphere
from tests.sshade.files.test_formats import mixed
from tests.sshade.files.test_gltf import instanced

BODY, BALL = bumpy(1), icosphere(0)
MUTATIONS = 300
#: Words of the formats.
TOKENS = b"""v;f;solid;facet;vertex;endloop;OFF;COFF;ply;format ascii 1.0;end_header;element vertex ;[[;../
;{};
property list uchar int vertex_indices;property list int int ;"handles";"vertices";"source";"target";"kind";
"files";nan;inf;1e999;-1;0;99999999999999999999""".split(b";")
#: Names and contents of files.
Files = Iterator[tuple[str, bytes]]


READERS = {
    "pose.json": partial(read_handles, "pose.json", BODY),
    "dataset.json": partial(read_dataset, Path(), intact=False),
    "row.json": partial(read_row, Path()),
    "rows.csv": partial(read_csv, Path("rows.csv")),
    "vert.vert": lambda: Mesh(*SourceShape("a", Path("vert.vert")).arrays()),
    "tri.tri": lambda: Mesh(*SourceShape("a", Path("tri.vert")).arrays()),
    **{f"mesh{suffix}": partial(read_mesh, f"mesh{suffix}") for suffix in SUFFIXES},
}


def meshes() -> Files:
    for suffix in SUFFIXES:
        write_mesh(f"seed{suffix}", BALL.V, BALL.F)
        yield f"mesh{suffix}", Path(f"seed{suffix}").read_bytes()
    for name in ("studio.obj", "colours.off", "two_facets.stl", "old_meshlab.ply"):
        yield f"mesh{Path(name).suffix}", sample(name).encode()
    for order in ("", "<", ">"):
        yield "mesh.ply", mixed(order)
    yield "mesh.glb", glb(*instanced())


def handles() -> Files:
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


def records() -> Files:
    build(Balls(subjects=(0,)), Path("balls"), options=OPTIONS, workers=1)
    yield "dataset.json", Path("balls/dataset.json").read_bytes()
    row = {"task.name": "t", "method.name": "m", "method.hash": "h", "seed": 0, "status": "ok", "key": "k"}
    row |= {"date": "2026-01-01", "env.machine": "box", "metric.edge": 1.5, "seconds.total": 2.0}
    yield "row.json", json.dumps(row).encode()
    write_csv(Path("seed.csv"), to_frame([row, row | {"seed": 1}]))
    yield "rows.csv", Path("seed.csv").read_bytes()


def shapes() -> Files:
    """Coordinates have a sound file of triangles beside them, and the other way."""
    np.savetxt("tri.vert", BALL.V, fmt="%.9g")
    np.savetxt("vert.tri", BALL.F + 1, fmt="%d")
    yield "vert.vert", Path("tri.vert").read_bytes()
    yield "tri.tri", Path("vert.tri").read_bytes()


def mutated(data: bytes, seeds: list[bytes], rng: np.random.Generator) -> bytes:
    """Return bytes with one or two random changes; seeds and tokens lend parts."""
    for _ in range(int(rng.integers(1, 3))):
        at = int(rng.integers(len(data) + 1))
        end = min(len(data), at + int(rng.geometric(0.2)))
        other, token = (parts[int(rng.integers(len(parts)))] for parts in (seeds, TOKENS))
        start = int(rng.integers(len(other) + 1))
        part = other[start : start + int(rng.geometric(0.02))]
        new = [rng.bytes(end - at), b"", 2 * data[at:end], token, token + data[at:end], part][rng.integers(6)]
        data = data[:at] + new + (data[end:] if rng.random() < 0.97 else b"")
    return data


def is_read(name: str, data: bytes) -> bool:
    """Whether a file was read; anything but an InputError of one line comes through."""
    Path(name).write_bytes(data)
    try:
        READERS[name]()
    except InputError as error:
        assert "\n" not in str(error), f"more than a line: {error!r}"
        return False
    return True


@pytest.mark.parametrize("files", [meshes, handles, records, shapes])
def test_mutated_inputs_are_read_or_refused(here, files):
    seeds, rng = list(files()), np.random.default_rng(0)
    assert all(is_read(*seed) for seed in seeds)
    contents, read = [content for _, content in seeds], 0
    for number in range(MUTATIONS):
        name, content = seeds[number % len(seeds)]
        read += is_read(name, mutated(content, contents, rng))
    assert 0 < read < MUTATIONS  # the mutations are neither all harmless nor all fatal

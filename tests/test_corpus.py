"""Run one method on a part of the corpus of mesh files, and test that the corpus' checks find faults."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tools.corpus.case import Case
from tools.corpus.cases import cases
from tools.corpus.check import faults
from tools.corpus.document import Document, read
from tools.corpus.handles import made
from tools.corpus.joints import Joints
from tools.corpus.plain import content
from tools.corpus.run import WRONG, try_case
from tools.corpus.shapes import body, soup
from tools.corpus.write import Gltf

#: Kinds whose cases are all tried. Every fourth case of the corpus is tried, too.
WHOLE = ("bad", "handles", "ply", "obj", "off", "stl", "gltf")
SOME = [case for k, case in enumerate(cases()) if case.name.startswith(WHOLE) or k % 4 == 0]


@pytest.mark.parametrize("kind", sorted({case.name.partition("/")[0] for case in SOME}))
def test_no_file_of_the_corpus_goes_wrong(kind, tmp_path):
    tried = [case for case in SOME if case.name.startswith(f"{kind}/")]
    outcomes = [outcome for case in tried for outcome in try_case(case, ["fast"], tmp_path)]
    assert not [outcome for outcome in outcomes if outcome.verdict == WRONG]


def test_the_corpus_has_many_files():
    assert len({case.name for case in cases()}) == len(cases()) >= 400


@pytest.mark.parametrize("suffix", [".ply", "f4.ply", ".obj", ".off", ".stl", ".glb"])
def test_the_readers_agree_with_trimesh(suffix, tmp_path):
    file = tmp_path / f"mesh{suffix.removeprefix('f4')}"
    file.write_bytes(content(body(2), suffix))
    own, other = read(file), trimesh.load(file, process=False, force="mesh")
    np.testing.assert_allclose(own.V[own.F], other.vertices[other.faces], rtol=0, atol=1e-6)


def test_the_reader_places_instances_as_trimesh_does(tmp_path):
    gltf = Gltf()
    gltf.mesh(*body(1), node={"rotation": [0.5, 0.5, 0.5, 0.5], "scale": [1, 2, 3], "translation": [4, 5, 6]})
    gltf.show(0, matrix=[1, 0, 0, 0, 0.3, 1, 0, 0, 0, 0, 2, 0, 3, -1, 2, 1])
    (tmp_path / "mesh.glb").write_bytes(gltf.glb())
    own, other = read(tmp_path / "mesh.glb"), trimesh.load(tmp_path / "mesh.glb", force="mesh", process=False)
    assert len(own.V) == len(other.vertices) == 84
    np.testing.assert_allclose(np.sort(own.V, axis=0), np.sort(other.vertices, axis=0), atol=1e-5)


V, F = soup(body(2))
REST = Document(V, F, ["colours"], 0.0)
JOINTS = Joints(REST)
HANDLES = made(REST, JOINTS, "soup")
#: Handles whose targets are their rest positions, so that the rest mesh is a sound result.
STILL = replace(HANDLES, target=V[HANDLES.index], complete=False)
FREE = int(np.setdiff1d(np.arange(len(V)), HANDLES.index)[0])
COPIES = np.flatnonzero(JOINTS.place == JOINTS.place[FREE])


def _moved(index, shift) -> Document:
    W = V.copy()
    W[index] += shift
    return replace(REST, V=W)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (REST, None),
        (_moved(slice(None), np.zeros(3)), None),
        (_moved(COPIES, [0.01, 0, 0]), None),
        (_moved([FREE], [0.01, 0, 0]), "torn: copies"),
        (_moved([FREE], [1e-6, 0, 0]), "torn: copies"),
        (_moved(HANDLES.index, [0.001, 0, 0]), "from its target, without a warning"),
        (_moved(COPIES, [0.5, 0, 0]), "edges are torn"),
        (_moved([FREE], [np.nan, 0, 0]), "not finite"),
        (replace(REST, F=F[::-1]), "faces or their order"),
        (replace(REST, V=V[:-1]), "vertices became"),
        (replace(REST, rest=["grey"]), "contents other than positions"),
    ],
)
def test_the_checks_find_faults(result, words):
    found = " ".join(faults(REST, result, JOINTS, STILL, [], stretch=1.2))
    assert words in found if words else not found


def test_a_true_warning_excuses_a_missed_handle_and_a_false_one_does_not():
    gap = np.full(3, 0.01 * JOINTS.diagonal / 3**0.5)
    result = _moved(slice(None), gap)
    for told, fine in (("1.1", True), ("0.1", False), ("30", False)):
        lines = [f"warning: a handle is {told} % of the diagonal from its target"]
        assert ("target" not in " ".join(faults(REST, result, JOINTS, STILL, lines))) == fine


def test_a_sound_mesh_that_must_be_refused_is_wrong(tmp_path):
    sound = next(case for case in cases() if case.name == "ply/vertex_index")
    (outcome,) = try_case(replace(sound, refused=("no triangles",)), ["fast"], tmp_path)
    assert outcome.verdict == WRONG and "must be refused" in outcome.text
    bad = Case("bad", "mesh.ply", lambda: {"mesh.ply": b""})
    (outcome,) = try_case(bad, ["fast"], tmp_path)
    assert outcome.verdict == WRONG and "refused: error:" in outcome.text

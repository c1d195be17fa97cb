"""verify finds each kind of damage, and names the file."""

import json

import numpy as np
import pytest

from defaust.build.verify import verify
from defaust.folder.layout import checksum, dump, sha256
from sshade import InputError
from sshade.io.meshes import read_mesh, write_mesh


def relist(root, name):
    """Enter a changed file into dataset.json, so that only its content can give it away."""
    path = root / "dataset.json"
    document = json.loads(path.read_text())
    document["files"][name] |= {"sha256": sha256(root / name), "bytes": (root / name).stat().st_size}
    document["checksum"] = checksum(document)
    path.write_text(dump(document))


def files(faults):
    return sorted({fault.file for fault in faults})


def test_intact(finished):
    calls = []
    assert verify(finished, progress=lambda *args: calls.append(args)) == []
    assert ("subjects", 3, 3) in calls


@pytest.mark.parametrize("name", ["subject_01/rest.ply", "subject_02/rest_low.ply", "subject_00/pose_1.json"])
def test_a_flipped_byte_or_a_missing_file(dataset, name):
    data = bytearray((dataset / name).read_bytes())
    data[len(data) // 2] ^= 1
    (dataset / name).write_bytes(data)
    assert verify(dataset)[0] == (name, "its sha256 is not the one listed")
    assert files(verify(dataset)) == [name]
    (dataset / name).unlink()
    assert verify(dataset) == [(name, "missing")]


def test_changed_record(dataset):
    path = dataset / "dataset.json"
    path.write_text(path.read_text().replace('"seed": 0', '"seed": 5'))
    assert files(verify(dataset)) == ["README.md", "dataset.json"]


def test_record_without_an_entry(dataset):
    path = dataset / "dataset.json"
    document = json.loads(path.read_text())
    del document["files"]["subject_00/rest.ply"], document["files"]["README.md"]
    document["checksum"] = checksum(document)
    path.write_text(dump(document))
    texts = [fault.text for fault in verify(dataset)]
    assert "lists no README.md" in texts and "lists no subject_00/rest.ply" in texts


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h[0]["target"].__setitem__(0, [0.0, 0.0, 0.0]), "a target is not its vertex"),
        (lambda h: h[0]["source"].__setitem__(2, [9.0, 9.0, 9.0]), "handle 2 is no vertex of rest_low.ply"),
        (lambda h: h[1]["source"].pop(), "has 5 handles, not 6"),
        (lambda h: h[1]["source"].__setitem__(1, h[1]["source"][0]), "a vertex serves twice"),
        (lambda h: h[1]["source"].__setitem__(1, h[0]["source"][0]), "a vertex serves twice"),
        (lambda h: h[0].update(delta=1.0), "delta is 1.0"),
        (lambda h: h[0].update(delta_mean=1.0), "delta_mean is 1.0"),
        (lambda h: h[1].update(kind="dynamic"), "listed as dynamic, and static when recomputed"),
        (lambda h: h[0].update(kind="unused"), "unused, but it has handles"),
        (lambda h: h.reverse(), "its landmarks are not those of the dataset"),
        (lambda h: h[0].update(delta=None), "delta is None"),
        (lambda h: h[0].pop("kind"), "it has no handles[0].kind"),
    ],
)
def test_wrong_handle(dataset, change, message):
    name = "subject_01/pose_1.json"
    content = json.loads((dataset / name).read_text())
    change(content["handles"])
    (dataset / name).write_text(dump(content))
    relist(dataset, name)
    faults = verify(dataset)
    assert files(faults) == [name]
    assert message in faults[0].text


def test_wrong_meshes(dataset):
    low = read_mesh(dataset / "subject_00/rest_low.ply")
    high = read_mesh(dataset / "subject_02/rest.ply")
    write_mesh(dataset / "subject_00/rest.ply", low.V, low.F)
    write_mesh(dataset / "subject_01/pose_1_low.ply", low.V, low.F[:, [1, 2, 0]])
    write_mesh(dataset / "subject_01/pose_2_low.ply", low.V, low.F[1:])
    write_mesh(
        dataset / "subject_02/rest.ply",
        np.concatenate([high.V, high.V + 5]),
        np.concatenate([high.F, high.F + high.n]),
    )
    (dataset / "subject_02/pose_1_low.ply").write_bytes(b"not a mesh")
    expected = {
        "subject_00/rest.ply": "has 642 vertices and 1280 faces, not",
        "subject_01/pose_1_low.ply": "its faces are not those of rest_low.ply",
        "subject_01/pose_2_low.ply": "not closed: 3 boundary edges",
        "subject_02/rest.ply": "2 components",
        "subject_02/pose_1_low.ply": "",
    }
    for name in expected:
        relist(dataset, name)
    faults = {fault.file: fault.text for fault in verify(dataset)}
    assert set(faults) == set(expected)
    for name, text in expected.items():
        assert text in faults[name]


def test_no_dataset(tmp_path, dataset):
    with pytest.raises(InputError, match="no such folder"):
        verify(tmp_path / "nowhere")
    with pytest.raises(InputError, match="not a finished DeFAUST folder.*source.root="):
        verify(tmp_path)
    path = dataset / "dataset.json"
    text = path.read_text()
    for content, message in (
        ("{", "not a readable JSON"),
        ("[1]", "not a DeFAUST record"),
        (text.replace('"format": 1', '"format": 99'), "format 99 is not the supported 1"),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=message):
            verify(dataset)

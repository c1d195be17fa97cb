"""verify finds every kind of damage, and names the file."""

import pytest

from defaust.build.verify import verify
from sshade.files.meshes import read_mesh, write_mesh
from tests.defaust.toy import change, change_handles, relist
from tests.shapes import beside, shifted


def test_record_without_an_entry(dataset):
    change(dataset, lambda d: [d["files"].pop(name) for name in ("subject_00/rest.ply", "README.md")])
    texts = [fault.text for fault in verify(dataset)]
    assert "lists no README.md" in texts and "lists no subject_00/rest.ply" in texts


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda h: h[0]["target"].__setitem__(0, [0.0, 0.0, 0.0]), "a target is not its vertex"),
        (lambda h: h[0]["source"].__setitem__(2, [9.0, 9.0, 9.0]), "handle 2 is no vertex of rest_low.ply"),
        (lambda h: h[1]["source"].pop(), "has 5 handles, not 6"),
        (lambda h: h[1]["source"].__setitem__(1, h[1]["source"][0]), "a vertex is a handle twice"),
        (lambda h: h[1]["source"].__setitem__(1, h[0]["source"][0]), "a vertex is a handle twice"),
        (lambda h: h[0].update(delta=1.0), "delta is 1.0"),
        (lambda h: h[1].update(kind="dynamic"), "listed as dynamic, and static when recomputed"),
        (lambda h: h[0].update(kind="unused"), "unused, but it has handles"),
        (lambda h: h.reverse(), "its landmarks differ from those of the dataset"),
        (lambda h: h[0].pop("kind"), "it has no handles[0].kind"),
    ],
)
def test_wrong_handle(dataset, edit, message):
    name = "subject_01/pose_1.json"
    change_handles(dataset, name, lambda content: edit(content["handles"]))
    faults = verify(dataset)
    assert {fault.file for fault in faults} == {name}
    assert message in faults[0].text


def test_wrong_meshes(dataset):
    low = read_mesh(dataset / "subject_00/rest_low.ply")
    high = read_mesh(dataset / "subject_02/rest.ply")
    write_mesh(dataset / "subject_00/rest.ply", low.V, low.F)
    write_mesh(dataset / "subject_01/pose_1_low.ply", low.V, low.F[:, [1, 2, 0]])
    write_mesh(dataset / "subject_01/pose_2_low.ply", low.V, low.F[1:])
    two = beside(high, shifted(high, 5))
    write_mesh(dataset / "subject_02/rest.ply", two.V, two.F)
    (dataset / "subject_02/pose_1_low.ply").write_bytes(b"not a mesh")
    expected = {
        "subject_00/rest.ply": "number of vertices: 642, not ",
        "subject_01/pose_1_low.ply": "its faces differ from those of rest_low.ply",
        "subject_01/pose_2_low.ply": "number of boundary loops (3 boundary edges): 1, not 0",
        "subject_02/rest.ply": "number of components: 2, not 1",
        "subject_02/pose_1_low.ply": "",
    }
    for name in expected:
        relist(dataset, name)
    faults = {fault.file: fault.text for fault in verify(dataset)}
    assert set(faults) == set(expected)
    for name, text in expected.items():
        assert text in faults[name]

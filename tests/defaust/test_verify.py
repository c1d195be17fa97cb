"""verify finds every kind of damage, and names the file."""

import pytest

from defaust.build.dataset import build
from defaust.build.verify import verify
from defaust.folder.record import read_dataset
from sshade import InputError
from sshade.files.meshes import read_mesh, write_mesh
from tests.defaust.toy import OPTIONS, Balls, change, change_handles, relist
from tests.shapes import beside, shifted


def test_a_changed_record_is_a_fault_and_is_not_read(dataset):
    change(dataset, lambda d: d["build"].update(seed=5), sign=False)
    assert [fault.text for fault in verify(dataset)] == ["its content does not match its own checksum"]
    for use in (read_dataset, lambda root: build(Balls(), root, options=OPTIONS)):
        with pytest.raises(InputError, match="changed after the build|seed was 5 and is now 0"):
            use(dataset)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda h: h[0]["target"].__setitem__(0, [0.0, 0.0, 0.0]), "a target is not its vertex"),
        (lambda h: h[0]["source"].__setitem__(2, [9.0, 9.0, 9.0]), "handle 2 is no vertex of rest_low.ply"),
        (lambda h: h[1]["source"].__setitem__(1, h[0]["source"][0]), "a vertex is a handle twice"),
        (lambda h: h[0].update(delta=1.0), "delta is 1.0"),
        (lambda h: h[1].update(kind="dynamic"), "listed as dynamic, and static when recomputed"),
    ],
)
def test_a_wrong_handle_is_found(dataset, edit, message):
    name = "subject_01/pose_1.json"
    change_handles(dataset, name, lambda content: edit(content["handles"]))
    (fault,) = verify(dataset)
    assert fault.file == name and message in fault.text


def test_wrong_meshes_are_found(dataset):
    low = read_mesh(dataset / "subject_00/rest_low.ply")
    high = read_mesh(dataset / "subject_02/rest.ply")
    two = beside(high, shifted(high, 5))
    write_mesh(dataset / "subject_00/rest.ply", low.V, low.F)
    write_mesh(dataset / "subject_01/pose_1_low.ply", low.V, low.F[:, [1, 2, 0]])
    write_mesh(dataset / "subject_02/rest.ply", two.V, two.F)
    expected = {
        "subject_00/rest.ply": "number of vertices: 642, not ",
        "subject_01/pose_1_low.ply": "its faces differ from those of rest_low.ply",
        "subject_02/rest.ply": "number of components: 2, not 1",
    }
    for name in expected:
        relist(dataset, name)
    (dataset / "subject_02/pose_1_low.ply").write_bytes(b"damaged")
    (dataset / "README.md").unlink()
    expected |= {"subject_02/pose_1_low.ply": "its sha256 differs", "README.md": "missing"}
    faults = dict(verify(dataset))
    assert faults.keys() == expected.keys()
    assert all(text in faults[name] for name, text in expected.items())

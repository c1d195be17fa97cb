"""The commands write a copy of the file that they read, with new positions."""

from pathlib import Path

import numpy as np
import pytest

from sshade.cli.main import main
from sshade.files.meshes import read_arrays, read_mesh, write_mesh
from tests.robustness.inputs import BODY
from tests.shapes import as_obj, bent, torn

pytestmark = pytest.mark.usefixtures("sound")

V, F, _ = torn(BODY)


def test_remesh_carry_and_transfers_keep_the_file_too():
    own, faces = V[1:], F - 1  # without the unused vertex, which these commands refuse
    Path("seam.obj").write_text(as_obj(own, faces))
    assert main(["remesh", "seam.obj", "-o", "proxy.ply", "--map", "m.npz", "--vertices", "40"]) == 0
    proxy = read_mesh("proxy.ply")
    write_mesh("edited.ply", proxy.V + [1, 2, 3], proxy.F)
    assert main(["carry", "seam.obj", "m.npz", "edited.ply", "-o", "out.obj"]) == 0
    moved, same = read_arrays("out.obj")
    assert np.allclose(moved, own + [1, 2, 3], rtol=0, atol=1e-12) and np.array_equal(same, faces)
    Path("body.obj").write_text(as_obj(BODY.V, BODY.F))
    posed = BODY.V[:, [1, 2, 0]]
    write_mesh("posed.ply", posed, BODY.F)
    assert main(["reconstruct", "body.obj", "posed.ply", "-o", "posed.obj", "--samplings", "1"]) == 0
    assert np.abs(read_arrays("posed.obj")[0] - posed).max() < 0.1 * BODY.diagonal
    line = ["transfer-pose", "body.ply", "posed.ply", "body.obj", "-o", "edited.obj", "--samplings", "1"]
    assert main(line) == 0  # the output has the contents of the edited shape
    for source, result in (("seam.obj", "out.obj"), ("body.obj", "posed.obj"), ("body.obj", "edited.obj")):
        old, new = (Path(name).read_text().partition("vt ")[2] for name in (source, result))
        assert old == new


def test_a_transfer_with_residual_gives_the_pose_back_to_its_own_shape():
    write_mesh("wavy.ply", BODY.V + 0.2 * np.sin(3 * BODY.V[:, [1, 2, 0]]), BODY.F)
    far = []
    for switch in ([], ["--residual"]):
        line = ["transfer-pose", "body.ply", "wavy.ply", "body.ply", "-o", "t.ply", "--vertices", "40"]
        assert main([*line, "--overwrite", *switch]) == 0
        far.append(np.abs(read_arrays("t.ply")[0] - read_arrays("wavy.ply")[0]).max() / BODY.diagonal)
    assert far[0] > 1e-3 and far[1] < 1e-6


def test_a_transfer_notices_a_pose_in_the_place_of_the_edit(capsys):
    write_mesh("bent.ply", bent(BODY.V), BODY.F)
    write_mesh("edited.ply", BODY.V * [1.02, 1, 1] + [9, 0, 0], BODY.F)  # also moved, which is no pose
    for shapes, noticed in ((["bent.ply", "edited.ply"], False), (["edited.ply", "bent.ply"], True)):
        line = ["transfer-pose", "body.ply", *shapes, "-o", "t.ply", "--vertices", "40", "--samplings", "1"]
        assert main(line) == 0
        told = "note: bent.ply is farther from body.ply than edited.ply; the pose comes first"
        assert (told in capsys.readouterr().err) is noticed

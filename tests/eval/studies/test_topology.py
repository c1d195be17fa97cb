"""The study of what remeshing keeps: its lines, and its exit code."""

import numpy as np
import pytest

from eval.main import call
from eval.studies.topology import check
from sshade.errors import InputError
from sshade.io.meshes import write_mesh
from sshade.mesh.mesh import Mesh
from tests.shapes import torus, tube


def test_a_torus_and_a_tube_keep_their_topology(tmp_path, capsys):
    for name, mesh in (("torus", torus(40, 20)), ("tube", tube(20, 40))):
        write_mesh(tmp_path / f"{name}.ply", mesh.V, mesh.F)
    paths = [str(tmp_path / f"{name}.ply") for name in ("torus", "tube")]
    assert call("topology", [*paths, "--samples", "100", "200", "9000"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0][-4:] == ["euler", "components", "loops", "result"]
    assert [line[-4:] for line in lines[1:3]] == [["0", "1", "0", "ok"]] * 2
    assert [line[-4:] for line in lines[3:5]] == [["0", "1", "2", "ok"]] * 2
    assert lines[5][:3] == ["4", "of", "4"]


def test_what_cannot_be_remeshed_is_told(tmp_path):
    one = torus()
    two = Mesh(np.concatenate([one.V, one.V + 5]), np.concatenate([one.F, one.F + one.n]))
    assert "2 components" in check(two, 50)["result"]
    with pytest.raises(InputError, match="no subject_"):
        call("topology", [str(tmp_path)])

"""The code and the commands of docs/applications.md run in their order, and agree with each other."""

import numpy as np
import pytest

from docs.applications import run_examples
from sshade import read

pytest.importorskip("pymeshlab")


@pytest.mark.full
def test_the_examples_run_and_the_commands_give_what_the_code_gives(here, capfd):
    names = run_examples(here, subdivisions=0)
    mesh, posed = names["mesh"], names["posed"]
    for file, name in {
        "edited_posed.ply": "edited_posed",
        "rebuilt.ply": "rebuilt",
        "twisted_body.ply": "twisted_body",
    }.items():
        assert np.abs(read(file).V - names[name]).max() < 1e-5 * mesh.diagonal, file
    assert np.linalg.norm(names["edited_posed"] - posed, axis=1).max() > 0.08  # the belly
    assert "note:" not in capfd.readouterr().err.partition("edited_posed.ply")[2].partition("rebuilt.ply")[0]
    np.testing.assert_allclose(read("armadillo_posed.ply").V, names["result"].vertices, atol=1e-5)
    assert names["result"].vertices[:, 2].max() > names["armadillo"].V[:, 2].max() + 0.1  # an arm in front
    assert np.abs(names["distance"][names["binding"].sampling.samples] - names["coarse"]).max() < 1e-9
    assert (here / "distance.html").stat().st_size > 100_000

"""Shapes come in through one door, and results are no shapes that came in."""

from types import SimpleNamespace

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.files.door import open_shape
from tests.shapes import bumpy

BODY = bumpy(2)


@pytest.mark.parametrize("given", [(BODY.V, BODY.F), (BODY,)])
def test_a_result_is_a_copy_also_if_it_is_the_shape_itself(given):
    shape = open_shape(*given)
    moved = shape.moved(shape.mesh.V)
    moved = moved.V if isinstance(moved, Mesh) else moved
    assert np.array_equal(moved, BODY.V) and not np.shares_memory(moved, BODY.V)


def test_what_is_no_shape_is_refused():
    with pytest.raises(InputError, match="no mesh in an object of type SimpleNamespace"):
        open_shape(SimpleNamespace(vertices=BODY.V))

"""Work by ranges of rows: the same bits from one range and one thread, and from many of both."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.core.threads import in_ranges
from sshade.mesh.faces import connectivity
from sshade.proxy.binding import bind_proxy
from sshade.proxy.blended import BlendedFrames
from sshade.proxy.sample import proxy_mesh, sample_proxy
from tests.shapes import double_torus, icosphere, jittered, tube
from tests.sshade.mesh.test_connectivity import CASES

MESHES = [jittered(icosphere(3), 0.02), jittered(double_torus(cells=3), 0.01), jittered(tube(12, 20), 0.02)]


@pytest.fixture
def many(monkeypatch):
    """A function after which ranges are of seven rows, in three threads."""

    def split() -> None:
        monkeypatch.setattr("sshade.core.threads.CHUNK", 7)
        monkeypatch.setattr("sshade.mesh.faces.FACES", 5)
        for module in ("sshade.core.threads", "sshade.mesh.faces"):
            monkeypatch.setattr(f"{module}.available_cpus", lambda: 3)

    return split


def arrays(value: object) -> list[np.ndarray]:
    """All arrays and numbers of a nested tuple or of an object."""
    if isinstance(value, tuple):
        return [array for part in value for array in arrays(part)]
    return [np.asarray(value)] if not hasattr(value, "__dict__") else arrays(tuple(vars(value).values()))


def assert_same_bits(one: object, other: object) -> None:
    for a, b in zip(arrays(one), arrays(other), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b)


@pytest.mark.parametrize("n", [0, 1, 6, 7, 8, 50])
def test_ranges_cover_all_rows_in_order(many, n):
    many()
    ranges = in_ranges(lambda first, end: list(range(first, end)), n)
    assert sum(ranges, []) == list(range(n)) and all(len(rows) <= 7 for rows in ranges)


@pytest.mark.parametrize("case", range(len(CASES)))
def test_connectivity_of_soups_and_shapes(many, case):
    one = connectivity(*CASES[case])
    many()
    assert_same_bits(connectivity(*CASES[case]), one)


@pytest.mark.parametrize("shape", range(len(MESHES)))
def test_a_proxy_and_what_is_bound_to_it(many, shape):
    def bound() -> object:
        mesh = Mesh(MESHES[shape].V, MESHES[shape].F)  # which remembers nothing
        sampling = sample_proxy(mesh, 60, seed=3)
        binding = bind_proxy(mesh, sampling, frames=lambda proxy, _: BlendedFrames(proxy))
        bent = proxy_mesh(mesh, sampling).V * [1.0, 1.2, 0.9] + np.sin(binding.proxy.V[:, [1, 2, 0]])
        return sampling, binding.projection, binding.local, binding.carry(bent)

    one = bound()
    many()
    assert_same_bits(bound(), one)

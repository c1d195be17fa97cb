"""What numba makes of the kernels is what they say."""

from __future__ import annotations

import numpy as np

from tests.robustness.uncompiled import CLOSE, Comparison, compare, kernels


def test_every_kernel_gives_uncompiled_what_it_gives_compiled():
    found = compare()
    assert found.failures == []
    assert sorted(found.called) == sorted(kernels())


def test_kernels_are_found_by_their_decorator():
    assert "sshade/carry/frames.py:_decode" in kernels() and len(kernels()) > 100
    assert not any(name.endswith((":deform", ":frame_values")) for name in kernels())


def test_what_counts_as_a_failure():
    sound = Comparison({"a": 0.5 * CLOSE}, ["f.py:k"], [])
    assert sound.failures == []
    assert sound._replace(apart={"a": 2 * CLOSE}).failures == ["a: 2.0e-09 apart"]
    assert sound._replace(apart={"a": np.nan}).failures == ["a: nan apart"]
    assert sound._replace(missed=["f.py:k"]).failures == [
        "f.py:k was not called; kernel_work.py needs work that does"
    ]

"""The comparison of two source trees finds a difference above its limit."""

import numpy as np
import pytest

from tools.compare import all_cases, difference, limit


@pytest.mark.parametrize(
    ("name", "moved", "differs"),
    [
        ("tube deform fast", 2e-9, True),
        ("tube deform fast", 5e-10, False),
        ("tube deform fine", 2e-6, True),
        ("tube deform fine", 2e-9, False),
        ("tube deform fast", np.nan, True),
    ],
)
def test_a_moved_vertex_is_a_difference_above_the_limit(tmp_path, name, moved, differs):
    V = np.random.default_rng(0).normal(size=(2, 50, 3))
    folders = tmp_path / "this", tmp_path / "other"
    for folder, shift in zip(folders, (0, moved), strict=True):
        folder.mkdir()
        V[1, 7, 2] += shift
        np.save(folder / f"{name}.npy", V)
    found = difference(name, folders)
    assert found == pytest.approx(moved, rel=1e-5, nan_ok=True)
    assert (not found <= limit(name)) == differs


def test_a_missing_result_is_a_difference(tmp_path):
    np.save(tmp_path / "tube.npy", np.zeros((4, 3)))
    assert difference("tube", (tmp_path, tmp_path / "other")) == np.inf


def test_each_case_has_a_name_of_its_own():
    names = [case.name for case in all_cases(large=True)]
    assert len(set(names)) == len(names)

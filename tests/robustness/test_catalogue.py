"""Every case of the catalogue that is quick."""

from __future__ import annotations

import pytest

from tests.robustness.case import attempt
from tests.robustness.catalogue import CASES
from tests.robustness.inputs import write_sound


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_case(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_sound()
    attempt(case)

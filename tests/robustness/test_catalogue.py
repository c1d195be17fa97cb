"""Bad and hard inputs, each with a name: message, exit code, files left."""

import pytest

from tests.robustness import datasets, evaluation, outputs
from tests.robustness.case import attempt

PARTS = (outputs, datasets, evaluation)
CASES = [case for part in PARTS for case in part.CASES]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case, sound):
    attempt(case)

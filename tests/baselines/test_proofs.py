"""Each baseline names its proof: libigl's own call, its authors' program, a closed form, or formulas."""

import re
from inspect import getdoc, getmodule
from pathlib import Path

import pytest
import yaml
from hydra.utils import get_method

ROOT = Path(__file__).parents[2]
TARGETS = {
    target
    for path in (ROOT / "conf/method").rglob("*.yaml")
    if (target := yaml.safe_load(path.read_text(encoding="utf-8")).get("_target_", "")).startswith(
        "baselines."
    )
}


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_a_baseline_names_its_proof_and_the_file_of_its_test(target):
    method = get_method(target)
    text = f"{getdoc(method)}\n{getdoc(getmodule(method))}"
    (proof,) = re.findall(r"^Proof: (.+?)(?:\n\n|\Z)", text, flags=re.MULTILINE | re.DOTALL)
    tests = re.findall(r"tests/\S+\.py", proof)
    assert tests and all((ROOT / path).is_file() for path in tests)

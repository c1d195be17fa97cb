"""croissant.json describes every file and case; the validator of the format accepts it and reads handles."""

import json

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.folder.layout import sha256
from defaust.sources.generated.shapes import Shapes
from tests.defaust.toy import KEPT
from tests.files import contents


def test_every_file_and_case(finished):
    content = json.loads((finished / "croissant.json").read_text())
    listed = {entry["@id"]: entry for entry in content["distribution"] if entry["@type"] == "cr:FileObject"}
    files = contents(finished).keys()
    assert set(listed) == files - {"croissant.json"}
    for name, entry in listed.items():
        assert entry["sha256"] == sha256(finished / name)
        assert entry["contentSize"] == f"{(finished / name).stat().st_size} B"
    cases = content["recordSet"][0]["data"]
    found = [(case["cases/subject"], case["cases/pose"]) for case in cases]
    assert found == [(s, k) for s in range(3) for k in (1, 2)]
    assert {case["cases/target"] for case in cases} < files


@pytest.fixture(scope="module", params=["landmarks", "regions"])
def folder(request, finished, tmp_path_factory):
    if request.param == "landmarks":
        return finished
    out = tmp_path_factory.mktemp("data") / "shapes"
    build(Shapes(), out, options=KEPT, workers=1)
    return out


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # from libraries of the validator
def test_the_validator_of_the_format(folder):
    mlcroissant = pytest.importorskip("mlcroissant", reason="the extra hubs is not installed")
    dataset = mlcroissant.Dataset(folder / "croissant.json")
    assert not dataset.metadata.issues.errors
    stored = [
        (name, entry)
        for case in dataset.records("cases")
        for name in [case["cases/handles"]]
        for entry in json.loads((folder / name).read_text())["handles"]
    ]
    read = list(dataset.records("handles"))
    assert len(read) == len(stored)
    for record, (name, entry) in zip(read, stored, strict=True):
        kept = {key.removeprefix("handles/") for key in record}
        assert kept >= entry.keys() & {"source", "target", "boxes"}
        assert record["handles/file"].decode() == name
        for key, value in record.items():
            key = key.removeprefix("handles/")
            if key in ("landmark", "kind"):
                assert value.decode() == entry[key]
            elif key != "file":
                np.testing.assert_array_equal(value, entry[key])

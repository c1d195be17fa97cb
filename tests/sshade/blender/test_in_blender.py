"""The extension in Blender without its window; skipped where bpy, the extra blender-test, is missing."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from sshade.cli.blender import write_extension
from tests.sshade.blender.wheels import small_wheel

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.skipif(find_spec("bpy") is None, reason="needs bpy: pip install '.[blender-test]'")

SCALED = (
    "empty 'moving' was scaled, or the object's scale was applied; set the scale back, or clear the empty "
    "and choose it again"
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The facts of all scenes, from one process of Blender with the installed extension."""
    folder = tmp_path_factory.mktemp("blender")
    write_extension(folder / "sshade.zip", [small_wheel(folder)])
    call = [sys.executable, "-m", "tests.sshade.blender.scenes", folder / "sshade.zip", folder / "facts.json"]
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(folder / "user")}
    run = subprocess.run(call, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return json.loads((folder / "facts.json").read_text())


def test_the_extension_is_installed_with_its_wheels_and_leaves_nothing_when_disabled(report):
    finished, probe = report["installed"]
    assert finished == "FINISHED" and "extensions" in Path(probe).parts
    assert report["disabled"] is True


def test_results_are_bit_for_bit_the_ones_of_the_package(report):
    facts = report["operator"]
    assert facts["fast"] and facts["fine"] and facts["moved"] > 0.3
    assert facts["keys"] == ["Basis", "SShaDe", "SShaDe.001"] and facts["value"] == 1


@pytest.mark.parametrize("scene", ["operator", "live", "cancel"])
def test_everything_but_the_positions_stays(report, scene):
    """UVs, colours, materials, vertex groups, custom normals and modifiers."""
    assert report[scene]["kept"] is True


def test_a_shape_key_leaves_the_rest_shape(report):
    assert report["operator"]["rest"] and report["live"]["rest"]


def test_the_live_mode_follows_and_ends_at_the_result_of_the_operator(report):
    facts = report["live"]
    assert facts["off"] < 1e-6 * facts["diagonal"]  # hard handles are at the empty at each step
    assert facts["settled"] <= facts["lag"] < 0.02 * facts["diagonal"]
    assert facts["finished"] and facts["keys"] == ["Basis", "SShaDe"]


def test_cancel_restores_the_object(report):
    facts = report["cancel"]
    assert facts["moved"] > 0.3 and facts["keys"] == {"Basis": 1, "SShaDe": 1} and facts["running"] == 0
    assert facts["twice"] == [False, False]  # no second live mode, and no operator meanwhile


def test_undo_and_redo(report):
    facts = report["undo"]
    assert (facts["done"], facts["undone"], facts["redone"]) == (2, True, 2)
    assert facts["moved"] > 0.2 and facts["restored"] < 0.01 and facts["again"] < 0.01
    assert facts["finished"] == ["FINISHED"]


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ("moved", "mesh 'Body' was edited"),
        ("group", "the list of groups changed"),
        ("key", "its shape key 'SShaDe' is gone"),
    ],
)
def test_an_edit_ends_the_live_mode_and_nothing_is_lost(report, edit, said):
    message, stays, again = report["edited"][edit]
    assert message.startswith("the live mode ended, because ") and said in message and stays
    assert again == ""


def test_a_scaled_empty_pauses_the_live_mode(report):
    (message, moved), (none, later) = report["scaled_in_live_mode"]
    assert message == SCALED
    assert moved == 0 and none == "" and later > 0.1


@pytest.mark.parametrize(
    ("mistake", "said"),
    {
        "scaled": SCALED,
        "unequal": "object 'Body' has scales that are unequal or zero; apply its scale (Ctrl A, Scale)",
        "no group": "object 'Body' has no vertex group 'moving'",
        "deleted": "group 'moving' is moved, but has no empty in a scene; choose or add one",
        "no handles": "there are no groups; add vertex groups in the panel SShaDe",
        "twice": "group 'moving' is in the list twice; remove one of the two",
    }.items(),
)
def test_a_mistake_is_one_sentence_and_changes_nothing(report, mistake, said):
    assert report["refusals"][mistake] == [said, said, True]


def test_mistakes_in_the_list_of_handles(report):
    assert "has no vertex group" in report["refusals"]["no vertex group"][0]
    assert "is in the list already" in report["refusals"]["added twice"][0]


def test_the_script_of_the_page_bends_the_tube(report):
    facts = report["page"]
    start, move = np.array([0, 0, 7.75]), np.array([3.0, 0, -1.0])
    assert np.abs(np.array(facts["top"]) - start - move).max() < 0.02 and facts["foot"] == 0

"""The extension in Blender without its window; skipped where bpy, the extra blender-test, is missing."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from sshade.cli.blender import write_extension
from tests.sshade.blender.wheels import small_wheel

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.skipif(find_spec("bpy") is None, reason="needs bpy: pip install '.[blender-test]'")

#: Names of the functions of scenes.py, which imports bpy.
SCENES = re.findall(r"def (scene_\w+)", Path(__file__).with_name("scenes.py").read_text())


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The report of all scenes, from one process of Blender with the installed extension."""
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


@pytest.mark.parametrize("scene", SCENES)
def test_scene(report, scene):
    assert report[scene] == "", report[scene]

"""The command line: a real build, and one sentence for each mistake."""

import subprocess
import sys

import pytest

from defaust.cli import main
from defaust.folder.record import read_dataset
from defaust.tasks import list_tasks, load_task


def test_build_verify_info(tmp_path, capsys):
    out = tmp_path / "bodies"
    arguments = [f"out={out}", "subjects=[1]", "target_vertices=3000", "window=[0.7,1.5]", "workers=1"]
    assert main(["build", "source=synthetic", *arguments]) == 0
    document = read_dataset(out)
    assert document["subjects"][0]["low"]["vertices"] == 6890
    assert document["subjects"][0]["high"]["euler"] == 2
    assert len(list_tasks(out)) == 10
    for subject, pose in list_tasks(out):
        task = load_task(out, subject=subject, pose=pose)
        # All landmarks move in bend_twist, in hands_together of this body, and in sitting.
        assert (task.meta["n_static"] > 0) == (pose not in (4, 7, 9))
    assert main(["verify", str(out)]) == 0
    assert "every file is as listed" in capsys.readouterr().out
    assert main(["info", str(out)]) == 0
    text = capsys.readouterr().out
    assert "bend_twist" in text and document["checksum"] in text and "CC0" in text
    (out / "subject_01/pose_2.json").unlink()
    assert main(["verify", str(out)]) == 1
    assert capsys.readouterr().out.startswith("subject_01/pose_2.json: missing\n")


@pytest.mark.parametrize("arguments", [["bild"], [], ["verify"], ["--fast"]])
def test_a_mistake_in_the_arguments_is_one_sentence(arguments, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and "`defaust" in error


def test_module_runs_and_starts_light():
    code = "import sys, defaust.cli, defaust.tasks, defaust.build.dataset; print(*sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not {"pymeshlab", "trimesh", "hydra", "pandas"} & set(loaded.split())
    done = subprocess.run(
        [sys.executable, "-m", "defaust", "--help"], capture_output=True, text=True, check=True
    )
    assert "verify" in done.stdout


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["out=x", "source=faust"], "source.root is not set; add e.g. source.root=MPI-FAUST"),
        (["out=x", "window=[1]"], "window has 1 items, not 2"),
        (["out=x", "source.poses_used=[jump]"], "there is no 'jump'; choose from arms_up"),
        (["out=x", "+source.speed=1"], "unexpected keyword argument 'speed'"),
    ],
)
def test_wrong_overrides_are_refused(overrides, message, refused):
    refused(overrides, message)

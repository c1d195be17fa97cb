"""The experiment `isometric` runs on a user's sequence, from its configuration to its table.

Its mesh has 642 vertices, and all samples that are asked for although they are more than a quarter.
"""

from eval_program import run_eval

from defaust.cli import main as defaust
from eval.publish.notes import REBUILT_NOTE, TRANSFERRED_NOTE
from eval.publish.summary import make_table
from eval.rows.collect import collect
from sshade.files.meshes import write_mesh
from tests.shapes import bent, bumpy


def test_isometric(tmp_path):
    mesh = bumpy(3)
    (tmp_path / "meshes").mkdir()
    for k in range(3):
        write_mesh(tmp_path / "meshes" / f"blob{k}.ply", bent(mesh.V, 0.1 * k), mesh.F)
    arguments = ["build", "source=sequence", f"source.root={tmp_path / 'meshes'}", f"out={tmp_path / 'data'}"]
    # Transfers use no handles, but every dataset has handles.
    arguments += ["source.landmarks=2", "handles_per_landmark=5", "neighbourhood=10", "workers=1"]
    assert defaust(arguments) == 0

    sweep = ["-m", "experiment=isometric", "pose=all", "proxy.vertices=200", "method.samplings=1"]
    sweep += ["method.frames=triangle,blended_affine", "dataset.root=data"]
    done = run_eval(tmp_path, *sweep)
    assert done.returncode == 0 and done.stdout.count(": ok, ") == 4, done.stdout + done.stderr
    rows = collect(tmp_path / "out/runs/isometric")
    assert set(rows["method.name"]) == {"triangle-1", "blended_affine-1"}
    assert (rows["task.meta.posed_by"] == "registration").all() and (rows["extra.samples"] == 200).all()
    table = make_table(rows, title="isometric")
    assert table.means.at["blended_affine-1", "d_C"] < table.means.at["triangle-1", "d_C"]
    assert REBUILT_NOTE in table.notes and TRANSFERRED_NOTE not in table.notes
    assert [part.title for part in table.parts] == ["pose: blob1", "pose: blob2"]
    by_pose = {part.title: part.means["distance"].iloc[0] for part in table.parts}
    assert by_pose["pose: blob1"] < by_pose["pose: blob2"]

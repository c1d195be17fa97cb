"""The experiments of pose transfers, from their configurations to their tables, on a user's own sequence."""

from __future__ import annotations

import pytest
from eval_cases import run_eval

from defaust.cli import main as defaust
from eval.publish.notes import REBUILT_NOTE, TRANSFERRED_NOTE
from eval.publish.summary import make_table
from eval.publish.tables import to_markdown
from eval.rows.collect import collect
from sshade.io.meshes import write_mesh
from tests.shapes import bent, bumpy


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Three poses of a blob, built into a dataset."""
    folder = tmp_path_factory.mktemp("sequence")
    (folder / "meshes").mkdir()
    mesh = bumpy(3)
    for k in range(3):
        write_mesh(folder / "meshes" / f"blob{k}.ply", bent(mesh.V, 0.1 * k), mesh.F)
    arguments = ["build", "source=sequence", f"source.root={folder / 'meshes'}", f"out={folder / 'data'}"]
    # Handles are not used here, but a dataset has them.
    arguments += ["source.landmarks=2", "handles_per_landmark=5", "neighbourhood=10", "workers=1"]
    assert defaust(arguments) == 0
    return folder


def sweep(folder, *arguments):
    done = run_eval(folder, "-m", *arguments, "dataset=sequence", "dataset.root=data")
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_isometric(sequence):
    overrides = ["proxy.vertices=150", "method.frames=triangle,blended_affine", "method.samplings=1"]
    out = sweep(sequence, "experiment=isometric", "pose=all", *overrides)
    assert "4 runs: 4 new (4 ok)" in out
    rows = collect(sequence / "out/runs/isometric_sequence")
    assert set(rows["method.name"]) == {"triangle-1", "blended_affine-1"}
    assert (rows["task.meta.posed_by"] == "registration").all()
    table = make_table(rows, title="isometric")
    assert table.means.at["blended_affine-1", "d_C"] < table.means.at["triangle-1", "d_C"]
    assert REBUILT_NOTE in table.notes and TRANSFERRED_NOTE not in table.notes
    assert [part.title for part in table.parts] == ["pose: blob1", "pose: blob2"]
    by_pose = {part.title: part.means["distance"].iloc[0] for part in table.parts}
    assert by_pose["pose: blob1"] < by_pose["pose: blob2"]


def test_pose_transfer_without_a_truth(sequence):
    overrides = ["proxy.vertices=150", "edit@dataset.edit=inflate,stretch", "pose=1"]
    overrides.append("method=transfer/vertex_frames,transfer/residual")
    out = sweep(sequence, "experiment=pose_transfer", *overrides)
    # The last part of a method's name is its label.
    assert "vertex_frames defaust-sequence/subject_00/pose_1/inflate seed 0: ok" in out
    rows = collect(sequence / "out/runs/pose_transfer_sequence")
    assert set(rows["method.name"]) == {"vertex_frames", "residual"} and len(rows) == 4
    assert not any(name.startswith("metric.truth") for name in rows)
    text = to_markdown(make_table(rows, title="pose_transfer"))
    assert "| volume (%) | area (%) | EL (%) | FA (deg) |" in text
    assert "#### edit: inflate" in text and "reads the pose at every vertex" in text
    assert TRANSFERRED_NOTE in text and REBUILT_NOTE not in text
    assert rows["metric.volume"].notna().all()

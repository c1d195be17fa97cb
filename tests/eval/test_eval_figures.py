"""The comparison picture and what it is made from."""

from __future__ import annotations

import numpy as np
import pytest
from eval_cases import box, bumpy_task

from eval.main import call
from eval.publish.figures import Case as FigureCase
from eval.publish.figures import read_cases, view_of
from eval.run.run import run
from sshade.errors import InputError
from sshade.figures import edge_error

SOURCE = {"_target_": "eval_cases.bumpy_task", "level": 2}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    for angle in (10.0, 40.0):
        task = bumpy_task(level=2, angle=angle)
        for name in ("arap", "elastic"):
            method = {"_target_": f"baselines.arap.{name}", "max_iterations": 20}
            run(task, method, name=name, root=folder, source={**SOURCE, "angle": angle})
        run(task, {"_target_": "eval_cases.failing"}, name="failing", root=folder)
    return folder


def test_edge_error_of_a_stretched_box():
    mesh = box(1, 1, 1)
    assert edge_error(mesh, mesh.V) == pytest.approx(0)
    assert edge_error(mesh, 1.5 * mesh.V) == pytest.approx(50)
    longer = edge_error(mesh, mesh.V * [1, 1, 2])
    upright = (mesh.V[mesh.edges[:, 0], :2] == mesh.V[mesh.edges[:, 1], :2]).all(axis=1)
    sides = ~upright & (mesh.V[mesh.edges[:, 0], 2] != mesh.V[mesh.edges[:, 1], 2])
    change = np.where(upright, 100.0, np.where(sides, 100 * (2.5**0.5 - 1), 0.0))
    at_zero = (mesh.edges == 0).any(axis=1)
    assert longer[0] == pytest.approx(change[at_zero].mean())


def test_cases_come_from_the_run_folders(runs):
    cases = read_cases(runs, names=[], methods=[])
    assert [case.task.name for case in cases] == ["bumpy_10", "bumpy_40"]
    assert [list(case.results) for case in cases] == [["arap", "elastic"]] * 2
    only = read_cases(runs, names=["bumpy_40"], methods=["elastic"])
    assert [list(case.results) for case in only] == [["elastic"]]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["bumpy_99"]}, "no case 'bumpy_99'; there are bumpy_10, bumpy_40"),
        ({"methods": ["failing"]}, "no result of 'failing'"),
    ],
)
def test_what_was_not_run_is_a_clear_error(runs, options, message):
    with pytest.raises(InputError, match=message):
        read_cases(runs, **{"names": [], "methods": [], **options})


def test_a_changed_dataset_is_a_clear_error(tmp_path):
    run(
        bumpy_task(level=2),
        {"_target_": "eval_cases.stretching"},
        name="s",
        root=tmp_path,
        source={**SOURCE, "level": 3},
    )
    with pytest.raises(InputError, match="has changed since the run"):
        read_cases(tmp_path, names=[], methods=[])


def test_the_view_holds_every_shape_upright():
    task = bumpy_task(level=2)
    case = FigureCase(task, {"far": task.mesh.V + [0, 0, 3.0]})
    view = view_of(case, towards=np.array([1.0, 0.3, 0.2]), up=np.array([0.0, 0, 1]))
    assert view.up[2] > 0.9
    for V in (task.mesh.V, case.results["far"]):
        assert (np.abs((V - view.centre) @ view.right) < view.width / 2).all()
        assert (np.abs((V - view.centre) @ view.up) < view.height / 2).all()
    with pytest.raises(InputError, match="upright"):
        view_of(case, towards=np.array([0.0, 0, 1]), up=np.array([0.0, 0, 1]))


def test_the_picture_is_drawn_without_running_a_method(runs, tmp_path):
    pytest.importorskip("pyvista")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    out = tmp_path / "figures" / "tiny.png"
    assert (
        call("figures", [str(runs), "-o", str(out), "--towards", "1", "0", "0.2", "--up", "0", "0", "1"]) == 0
    )
    picture = pyplot.imread(out)
    height, width = picture.shape[:2]
    assert width > 1000 and height > 500
    # Something in each panel of the two rows and three columns.
    for i in range(2):
        for j in range(3):
            panel = picture[
                int(height * (0.25 + 0.5 * i)), int(width * 0.28 * j) : int(width * 0.28 * (j + 1)), :3
            ]
            assert (panel < 0.95).any()

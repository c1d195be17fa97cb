"""What every method of conf/method/transfer promises."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from eval_cases import bumpy_sphere
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf
from scipy.spatial.transform import Rotation

from eval.configure.targets import OWN_KEYS, check_parameters, instantiate, locate, parameter_hints
from sshade.cli.configuration import CONFIGURATION
from sshade.mesh.mesh import Mesh
from sshade.pipeline.transfer import TransferTask
from sshade.task import Method

METHODS = sorted(
    file.name.removesuffix(".yaml")
    for file in CONFIGURATION.joinpath("method", "transfer").iterdir()
    if file.name.endswith(".yaml")
)

#: Relative to the bounding-box diagonal.
CLOSE = 1e-12

#: Frames follow a coordinate of the mesh, so a general turn of it changes the result a little; and where a
#: vertex is as near to two triangles of the proxy, rounding decides whose frame carries it.
NEAR = 3e-3


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    overrides = [f"method=transfer/{request.param}", "proxy.vertices=200"]
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        config = compose("config", overrides=overrides, return_hydra_config=True)
        HydraConfig.instance().set_config(config)
        assert config.label == f"transfer/{request.param}"
        return OmegaConf.to_container(config.method, resolve=True)


@pytest.fixture(scope="module")
def task():
    rest = bumpy_sphere(3)
    x, y, z = rest.V.T
    edited = Mesh(rest.V * (1 + 0.2 * np.maximum(0, x) ** 3)[:, None], rest.F)
    return TransferTask("t", edited, rest, np.stack([x + 0.1 * z**2, y, z], axis=1))


def moved(task: TransferTask, turn: np.ndarray, shift: np.ndarray) -> TransferTask:
    """Rest, edit and pose, all turned and shifted."""
    return TransferTask(
        "moved",
        Mesh(task.mesh.V @ turn.T + shift, task.mesh.F),
        Mesh(task.rest.V @ turn.T + shift, task.rest.F),
        task.posed @ turn.T + shift,
    )


def test_its_yaml_names_a_method_and_every_parameter_of_it(method):
    function = locate(method["_target_"])
    taken = set(parameter_hints(function))
    assert set(inspect.signature(Method.__call__).parameters) - {"self"} <= taken
    assert set(method) - set(OWN_KEYS) == taken - {"task", "seed", "progress"}
    check_parameters(function, method.get("warm_up") or {}, target=method["_target_"])


def test_it_repeats_for_a_seed_and_leaves_its_input_alone(method, task):
    call = instantiate(method)
    before = [a.copy() for a in (task.mesh.V, task.rest.V, task.posed)]
    results = [call(task, seed=3).vertices for _ in range(2)]
    assert np.isfinite(results[0]).all() and results[0].shape == task.mesh.V.shape
    np.testing.assert_array_equal(*results)
    for array, copy in zip((task.mesh.V, task.rest.V, task.posed), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_the_rest_pose_and_rigid_poses_give_the_edited_shape(method, task):
    turn, shift = Rotation.from_rotvec([0.3, -0.5, 2.0]).as_matrix(), np.array([1.0, -2, 3])
    for R, t in ((np.eye(3), np.zeros(3)), (turn, shift)):
        posed = TransferTask("rigid", task.mesh, task.rest, task.rest.V @ R.T + t)
        gap = instantiate(method)(posed, seed=0).vertices - (task.mesh.V @ R.T + t)
        assert np.abs(gap).max() < CLOSE * task.rest.diagonal


def test_moving_everything_together_moves_the_result(method, task):
    call = instantiate(method)
    plain = call(task, seed=1).vertices
    shift = np.array([0.75, -1.25, 0.5])
    for turn in (np.eye(3), Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()):
        gap = np.abs(call(moved(task, turn, shift), seed=1).vertices - (plain @ turn.T + shift))
        assert gap.max() < NEAR * task.rest.diagonal
        assert np.median(gap) < (CLOSE if (turn == np.eye(3)).all() else 0.1 * NEAR) * task.rest.diagonal


def test_scaling_everything_scales_the_result(method, task):
    call = instantiate(method)
    scaled = TransferTask(
        "scaled", Mesh(64 * task.mesh.V, task.mesh.F), Mesh(64 * task.rest.V, task.rest.F), 64 * task.posed
    )
    gap = call(scaled, seed=1).vertices - 64 * call(task, seed=1).vertices
    assert np.abs(gap).max() < 64 * CLOSE * task.rest.diagonal

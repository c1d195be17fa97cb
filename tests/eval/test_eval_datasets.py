"""Every entry of conf/dataset loads the folder that its build command makes."""

import shlex

import pytest
from compositions import composed
from omegaconf import OmegaConf

from defaust.cli import main as defaust
from eval.run.config import check_root, source_of, task_of
from eval.run.targets import locate
from sshade.core.errors import InputError
from tests.defaust.registrations import write_faust

#: Entry -> name of its task and number of its cases.
BUILT = {
    "defaust": ("defaust-synthetic/subject_00/pose_1", 10),
    "faust": ("defaust-faust/subject_00/pose_1", 4),
}


def dataset(name, *overrides):
    """Return the plain settings of an entry."""
    return OmegaConf.to_container(composed(f"dataset={name}", *overrides).dataset, resolve=True)


def _load(config):
    check_root(config)
    return task_of(source_of(config), truth=True)


@pytest.mark.parametrize("name", BUILT)
def test_the_build_command_of_an_entry_makes_what_it_loads(name, here):
    (here / "data").mkdir()
    if name == "faust":
        write_faust(here / "MPI-FAUST" / "training" / "registrations")
    config = dataset(name)
    with pytest.raises(InputError, match="does not exist; make it with: ") as missing:
        _load(config)
    command = shlex.split(str(missing.value).partition("make it with: ")[2])
    assert command[:2] == ["defaust", "build"]
    assert defaust([*command[1:], "workers=1", "subjects=[0]", "target_vertices=null"]) == 0

    task_name, count = BUILT[name]
    task = _load(config)
    assert task.name == task_name and task.mesh.n in (6890, 642, 5041, 6831) and len(task.handles) > 8
    assert len(locate(config["cases"])(config["root"])) == count
    with pytest.raises(InputError, match=r"no subject 5; it has \[0"):
        _load(dataset(name, "subject=5"))

"""Every entry of conf/dataset loads the folder that its build command makes."""

import json
import shlex

import pytest
from compositions import composed
from omegaconf import OmegaConf

from defaust.cli import main as defaust
from eval.configure.app import _load_task
from eval.run.targets import locate
from sshade.core.errors import InputError
from sshade.files.meshes import write_mesh
from tests.defaust.registrations import write_faust
from tests.shapes import bumpy

#: Entry -> name of its task and number of its cases. One size of each kind stands for all sizes.
BUILT = {
    "defaust_20k": ("defaust-synthetic/subject_00/pose_1", 10),
    "noisy_25k": ("defaust-noisy_2mm/subject_00/pose_1", 5),
    "faust": ("defaust-faust/subject_00/pose_1", 4),
    "tosca": ("defaust-tosca/subject_00/pose_1", 3),
    "sequence": ("defaust-sequence/subject_00/pose_1", 1),
    "shapes_5k": ("defaust-shapes/subject_00/pose_1", 1),
    "animals_25k": ("defaust-animals/subject_00/pose_1", 4),
}


def dataset(name, *overrides):
    """Return the plain settings of an entry."""
    return OmegaConf.to_container(composed(f"dataset={name}", *overrides).dataset, resolve=True)


def write_originals(folder, name):
    """Write meshes like a user's, in the folders that the build commands name."""
    if name == "faust":
        write_faust(folder / "MPI-FAUST" / "training" / "registrations")
    mesh = bumpy(3)
    for place, names in (("TOSCA", ("cat0", "cat1", "dog0", "dog1", "dog2")), ("MESHES", ("a", "b"))):
        (folder / place).mkdir()
        for k, stem in enumerate(names):
            write_mesh(folder / place / f"{stem}.off", mesh.V * [1, 1, 1 + 0.2 * k], mesh.F)


@pytest.mark.parametrize("name", BUILT)
def test_the_build_command_of_an_entry_makes_what_it_loads(name, here):
    (here / "data").mkdir()
    write_originals(here, name)
    config = dataset(name)
    with pytest.raises(InputError, match="does not exist; make it with: ") as missing:
        _load_task(json.dumps(config))
    command = shlex.split(str(missing.value).partition("make it with: ")[2])
    assert command[:2] == ["defaust", "build"]
    smaller = [] if name in ("tosca", "sequence") else ["subjects=[0]", "target_vertices=null"]
    assert defaust([*command[1:], "workers=1", *smaller]) == 0

    task_name, count = BUILT[name]
    task = _load_task(json.dumps(config))
    assert task.name == task_name and task.mesh.n in (6890, 642, 5041, 6831) and len(task.handles) > 8
    assert len(locate(config["cases"])(config["root"])) == count
    with pytest.raises(InputError, match=r"no subject 5; it has \[0"):
        _load_task(json.dumps(dataset(name, "subject=5")))

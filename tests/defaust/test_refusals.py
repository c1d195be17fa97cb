"""Arguments of `defaust build` that are refused: one sentence each, and nothing is written."""

import pytest

from tests.defaust.registrations import write_faust
from tests.defaust.test_sequence import write_class
from tests.robustness.case import assert_refused
from tests.shapes import icosphere

CLASSES = "source=sequence source.root=classes"
FAUST = "source=faust source.root=faust"
#: Arguments and words of the sentence.
REFUSED = {
    "source=faust": "source.root is not set; add e.g. source.root=MPI-FAUST",
    "source=scape": "no source 'scape'",
    "source._target_=builtins.dict": "source._target_=builtins.dict makes a dict, and no source",
    "out=null": "out=None is no folder; give a name",
    "out=données": "in quotes twice",
    "out=classes/cat0.ply": "classes/cat0.ply is a file; give a folder",
    "out=classes/cat0.ply/x": "the folder cannot be created",
    "out=.": "is not empty and holds no DeFAUST build",
    "workers=0": "0 workers",
    "handles_per_landmark=61": "cannot be drawn",
    "+target_vertice=9": "no option target_vertice; did you mean 'target_vertices'?",
    "window=[1]": "window has 1 items, not 2",
    "window=[1.1,1.2]": "give two numbers around 1",
    "seed=true": "seed is True, not a whole number",
    "subjects=[]": "subjects is empty",
    "subjects=[1": "subjects=[1 is not",
    "subjects=[77]": "no subject 77",
    "source.poses_used=[jump]": "there is no 'jump'; choose from arms_up",
    "+source.speed=1": "unexpected keyword argument 'speed'",
    "source=noisy source.noise=-1": "source.noise is -1; give millimetres from 0 to 10",
    "source=sequence source.root='~nobody_here/x'": "no such folder",
    f"{CLASSES} source.name=a.b": "source.name=a.b is not made of letters",
    f"{CLASSES} source.classes=[bear]": "source.classes: there is no 'bear'; choose from cat, dog",
    f"{CLASSES} source.without=[cat,dog]": "source.without leaves no class of cat, dog",
    f"{CLASSES} source.landmarks={{}}": "source.landmarks is empty; give names and vertices",
    f"{CLASSES} source.landmarks={{a:1,b:1}}": "a shares vertex 1 with another landmark",
    f"{CLASSES} source.landmarks={{a:1}}": "there are the classes cat, dog; choose one with source.classes",
    f"{CLASSES} +source.facts.colour=red": "look at 'colour'",
    f"{FAUST} source.target_poses=[1,10]": "source.target_poses: there is no 10; choose from 0, 1, 2",
    f"{FAUST} source.target_poses=[0,1]": "source.target_poses holds 0, which is the rest pose",
    f"{FAUST} source.more_landmarks=[nose]": "'nose' is listed twice",
    f"{FAUST} source.landmarks.nose=6890": "the vertex of nose is 6890, but the registrations have 6890 vert",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two classes of meshes, and a folder in FAUST's layout."""
    root = tmp_path_factory.mktemp("refused")
    for name in ("cat", "dog"):
        write_class(root / "classes", name, icosphere(1))
    write_faust(root / "faust")
    return root


@pytest.mark.parametrize("arguments", REFUSED)
def test_it_is_refused(folder, monkeypatch, arguments):
    monkeypatch.chdir(folder)
    assert_refused("defaust", ["build", "out=x", *arguments.split(" ")], REFUSED[arguments])


@pytest.mark.parametrize("arguments", [["bild"], [], ["verify"], ["--fast"]])
def test_a_mistake_in_a_command_is_refused(here, arguments):
    assert_refused("defaust", arguments, "`defaust")

"""Cases: building, checking and using datasets."""

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

from defaust.build.dataset import build
from sshade.files.meshes import write_mesh
from tests.defaust.toy import OPTIONS, Balls, relist
from tests.files import contents, scratch
from tests.robustness.case import Case, check_refusal, limited, nothing, refused, run
from tests.robustness.inputs import BODY, Given, both, cut, patched
from tests.shapes import bent

RECORD = "balls/dataset.json"
RUN = "sshade-eval run dataset=defaust dataset.root=balls subject=0 pose=1 method=identity"


@cache
def _finished() -> Path:
    build(Balls(subjects=(0, 1)), scratch() / "balls of cases", options=OPTIONS, workers=1)
    return scratch() / "balls of cases"


def dataset() -> None:
    """A finished dataset of two balls."""
    shutil.copytree(_finished(), "balls")


def _damaged(name: str, damage: Callable[[str], Given], *, listed: bool = False) -> Given:
    """A finished dataset with a damaged file. If `listed`, the record has the damaged file's checksum."""
    entered = (lambda: relist(Path("balls"), name)) if listed else nothing
    return both(dataset, damage(f"balls/{name}"), entered)


def _removed(path: str) -> Given:
    return lambda: Path(path).unlink()


def _half(path: str) -> Given:
    return cut(path, 0.5)


REST = "subject_00/rest.ply"
CHANGED = both(dataset, patched(RECORD, b'"seed": 0', b'"seed": 5'))
#: Damaged datasets that a run refuses.
FILES = {
    "a record that was changed": (CHANGED, "changed after the build"),
    "a missing file": (_damaged(REST, _removed), "is missing; run the same defaust build again"),
    "a cut file": (_damaged(REST, _half), "not the file that the dataset lists"),
    "a cut file that is listed so": (_damaged(REST, _half, listed=True), "not a readable PLY"),
}


def shapes(*names: str) -> Given:
    """A folder of bodies in correspondence."""

    def write() -> None:
        Path("meshes").mkdir()
        for k, name in enumerate(names):
            write_mesh(f"meshes/{name}.ply", bent(BODY.V, 0.1 * k), BODY.F)

    return write


BUILD = "defaust build source=sequence source.root=meshes out=out source.landmarks=3 handles_per_landmark=5"
SMALL = f"{BUILD} neighbourhood=10 workers=1"
TWO = shapes("a", "b")
#: Options that `defaust build` refuses: alone, and in a build of two bodies (`OPTIONS_OF_TWO`).
OPTIONS_OF_BUILDS = {
    "out=out source=scape": ("no source 'scape'",),
    "out=out subjects=[1": ("subjects=[1 is not",),
    "out=données": ("in quotes twice",),
    "out=out subjects=[77]": ("no subject 77",),
}
OPTIONS_OF_TWO = {
    "out=body.ply": ("body.ply is a file; give a folder",),
    "out=body.ply/x": ("the folder cannot be created",),
    "out=.": ("is not empty and holds no DeFAUST build",),
    "workers=0": ("0 workers",),
    "handles_per_landmark=11": ("cannot be drawn",),
    "source._target_=builtins.dict": ("source._target_=builtins.dict makes a dict, and no source",),
}


def _cut_mesh() -> None:
    check_refusal(run(SMALL), "b.ply")


def _full_disk() -> None:
    """A build completes, then fails on a full disk and leaves only its recipe, then completes again."""
    assert run(SMALL)[0] == 0
    shutil.rmtree("out")
    with limited(3000):
        check_refusal(run(SMALL), "cannot be written (File too large)")
    assert list(contents("out")) == [".build/recipe.json"]
    assert run(SMALL)[0] == 0 and run("defaust verify out")[0] == 0


CASES = [
    *refused(RUN, FILES, prefix="dataset, run: "),
    *(Case(f"build: {o}", f"defaust build {o}", says=says) for o, says in OPTIONS_OF_BUILDS.items()),
    *(Case(f"build of two: {o}", f"{SMALL} {o}", TWO, says=says) for o, says in OPTIONS_OF_TWO.items()),
    Case("build: a cut mesh", _cut_mesh, both(TWO, cut("meshes/b.ply", 0.5))),
    Case("build: a full disk", _full_disk, shapes("a0", "a1", "b0", "b1"), leaves=("out",)),
]

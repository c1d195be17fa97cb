"""Cases: building, checking and using datasets."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from defaust.build.dataset import build
from defaust.folder.layout import checksum, dump, sha256
from sshade.io.meshes import write_mesh
from tests.defaust.toy import OPTIONS, Balls
from tests.robustness.case import Case, limited, run
from tests.robustness.inputs import BODY, Given, both, cut, data, folder, garbage, text
from tests.shapes import bent

VERIFY, INFO = "defaust verify balls", "defaust info balls"
RUN = "sshade-eval run dataset=defaust dataset.root=balls subject=0 pose=1 method=identity"


@cache
def _finished() -> Path:
    place = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    build(Balls(subjects=(0, 1)), Path(place) / "balls", options=OPTIONS, workers=1)
    return Path(place) / "balls"


def dataset() -> None:
    """A finished dataset of two balls."""
    shutil.copytree(_finished(), "balls")


def _record(edit: Callable[[dict[str, Any]], Any]) -> Given:
    """A finished dataset with its record edited and signed again."""

    def write() -> None:
        dataset()
        path = Path("balls/dataset.json")
        document = json.loads(path.read_text())
        edit(document)
        document["checksum"] = checksum(document)
        path.write_text(dump(document))

    return write


def _listed(name: str, damage: Given) -> Given:
    """A finished dataset with a file damaged, and listed as it is now."""

    def write() -> None:
        dataset()
        damage()
        entry = {"sha256": sha256(Path("balls", name)), "bytes": Path("balls", name).stat().st_size}
        text_ = json.loads(Path("balls/dataset.json").read_text())
        text_["files"][name] |= entry
        text_["checksum"] = checksum(text_)
        Path("balls/dataset.json").write_text(dump(text_))

    return write


def _of_all(name: str, given: Given, *says: str) -> list[Case]:
    """The same wrong dataset for whoever reads one."""
    calls = {"verify": VERIFY, "info": INFO, "run": RUN}
    return [Case(f"dataset, {what}: {name}", call, given, says=says) for what, call in calls.items()]


def _swap(path: str, old: str, new: str) -> Given:
    def write() -> None:
        content = Path(path).read_text()
        assert old in content
        Path(path).write_text(content.replace(old, new, 1))

    return write


RECORDS = [
    *_of_all("no folder", lambda: None, "balls", "folder"),
    *_of_all("an empty folder", folder("balls"), "not a finished DeFAUST folder"),
    *_of_all(
        "an unfinished build", both(dataset, lambda: Path("balls/dataset.json").unlink()), "not a finished"
    ),
    *_of_all("an empty record", both(dataset, data("balls/dataset.json", b"")), "not a readable JSON file"),
    *_of_all("a record of garbage", both(dataset, garbage("balls/dataset.json")), "not a readable JSON file"),
    *_of_all("a cut record", both(dataset, cut("balls/dataset.json", 0.7)), "not a readable JSON file"),
    *_of_all(
        "a record that is a list", both(dataset, text("balls/dataset.json", "[]")), "not a DeFAUST record"
    ),
    *_of_all(
        "a record of another format", _record(lambda d: d.update(format=9)), "format 9 is not the supported 1"
    ),
    *_of_all("a record without subjects", _record(lambda d: d.pop("subjects")), "it has no subjects"),
    *_of_all(
        "a record with a word for a count",
        _record(lambda d: d["subjects"][0]["high"].update(vertices="x")),
        "vertices is 'x', not a whole number",
    ),
    *_of_all(
        "a record that leads out",
        _record(lambda d: d["files"].update({"../body.ply": d["files"]["README.md"]})),
        "'../body.ply', which is not inside",
    ),
    Case(
        "dataset, info: a record that was changed",
        INFO,
        both(dataset, _swap("balls/dataset.json", '"seed": 0', '"seed": 5')),
        says=("changed after the build",),
    ),
    Case(
        "dataset, run: a record that was changed",
        RUN,
        both(dataset, _swap("balls/dataset.json", '"seed": 0', '"seed": 5')),
        says=("changed after the build",),
    ),
]


def _verified(*lines: str) -> Callable[[], None]:
    def holds() -> None:
        code, out, err = run(VERIFY)
        assert (code, err) == (1, ""), (code, err)
        for line in lines:
            assert line in out, out

    return holds


def _found(name: str, given: Given, *lines: str) -> Case:
    """Verify lists what is wrong, and ends with 1."""
    return Case(f"dataset, verify: {name}", VERIFY, given, code=1, holds=_verified(*lines))


FILES = [
    _found(
        "a missing file",
        both(dataset, lambda: Path("balls/subject_00/rest.ply").unlink()),
        "subject_00/rest.ply: missing",
    ),
    _found(
        "a cut file", both(dataset, cut("balls/subject_00/rest.ply", 0.5)), "subject_00/rest.ply: its sha256"
    ),
    _found(
        "a record that was changed",
        both(dataset, _swap("balls/dataset.json", '"seed": 0', '"seed": 5')),
        "own checksum",
    ),
    _found(
        "a cut file that is listed so",
        _listed("subject_00/rest.ply", cut("balls/subject_00/rest.ply", 0.5)),
        "not a readable PLY",
    ),
    _found(
        "a pose of garbage that is listed so",
        _listed("subject_00/pose_1.json", garbage("balls/subject_00/pose_1.json")),
        "not a readable JSON",
    ),
    Case(
        "dataset, run: a missing file",
        RUN,
        both(dataset, lambda: Path("balls/subject_00/rest.ply").unlink()),
        says=("is missing; run the same defaust build again",),
    ),
    Case(
        "dataset, run: a cut file",
        RUN,
        both(dataset, cut("balls/subject_00/rest.ply", 0.5)),
        says=("not the file that the dataset lists",),
    ),
    Case(
        "dataset, run: a cut file that is listed so",
        RUN,
        _listed("subject_00/rest.ply", cut("balls/subject_00/rest.ply", 0.5)),
        says=("not a readable PLY",),
    ),
    Case(
        "dataset, run: a pose without handles",
        RUN,
        _listed("subject_00/pose_1.json", text("balls/subject_00/pose_1.json", "{}")),
        says=("it has no source_pose",),
    ),
    Case("dataset, run: no such subject", f"{RUN} subject=7", dataset, says=("has no subject 7",)),
    Case("dataset, run: no such pose", f"{RUN} pose=7", dataset, says=("has no pose 7",)),
    Case(
        "dataset, run: an unknown resolution",
        f"{RUN} dataset.resolution=medium",
        dataset,
        says=("resolution 'medium' is unknown",),
    ),
]


def shapes(*names: str, suffix: str = ".ply") -> Given:
    """A folder of bodies in correspondence."""

    def write() -> None:
        Path("meshes").mkdir()
        for k, name in enumerate(names):
            write_mesh(f"meshes/{name}{suffix}", bent(BODY.V, 0.1 * k), BODY.F)

    return write


BUILD = "defaust build source=sequence source.root=meshes out=out source.landmarks=3 handles_per_landmark=5"
SMALL = f"{BUILD} neighbourhood=10 workers=1"


def _build(name: str, call: str, given: Given, *says: str) -> Case:
    return Case(f"build: {name}", call, given, says=says)


def _full_disk() -> None:
    """The first build is complete, the second, of more subjects, fails and leaves no half of one."""
    assert run(SMALL)[0] == 0
    shutil.rmtree("out")
    with limited(3000):
        code, out, err = run(SMALL)
    assert code == 2 and "cannot be written (File too large)" in err and err.count("\n") == 1, (code, err)
    left = sorted(str(p) for p in Path("out").rglob("*") if p.is_file())
    assert left == ["out/.build/recipe.json"], left
    assert run(SMALL)[0] == 0 and run("defaust verify out")[0] == 0


BUILDS = [
    _build("no out", "defaust build seed=1", lambda: None, "out is not set; add e.g. out=data/defaust"),
    _build("an unknown option", "defaust build out=out speed=1", lambda: None, "speed"),
    _build("an unknown source", "defaust build out=out source=scape", lambda: None, "no source 'scape'"),
    _build(
        "an option of another type",
        "defaust build out=out seed=many",
        lambda: None,
        "seed is 'many', not a whole number",
    ),
    _build(
        "a list that is not closed", "defaust build out=out subjects=[1", lambda: None, "subjects=[1 is not"
    ),
    _build("a name to be quoted", "defaust build out=données", lambda: None, "in quotes twice"),
    _build(
        "a subject that is not there", "defaust build out=out subjects=[77]", lambda: None, "no subject 77"
    ),
    _build("out is a file", f"{SMALL} out=body.ply", shapes("a", "b"), "body.ply is a file; give a folder"),
    _build("out is below a file", f"{SMALL} out=body.ply/x", shapes("a", "b"), "the folder cannot be made"),
    _build(
        "out holds something else",
        f"{SMALL} out=.",
        shapes("a", "b"),
        "is not empty and holds no DeFAUST build",
    ),
    _build("a missing root", SMALL, lambda: None, "meshes"),
    _build("a root without meshes", SMALL, text("meshes/a.txt", "x"), "holds no meshes"),
    _build("a root of one mesh", SMALL, shapes("a"), "no target pose"),
    _build("no workers", f"{SMALL} workers=0", shapes("a", "b"), "0 workers were asked for"),
    _build(
        "more handles than vertices around",
        f"{SMALL} handles_per_landmark=11",
        shapes("a", "b"),
        "cannot be drawn",
    ),
    _build(
        "a foreign function as source",
        f"{SMALL} source._target_=os.system",
        shapes("a", "b"),
        "named by no file of conf",
    ),
    _build(
        "an archive that is a pickle",
        f"{SMALL} source.root=meshes.npz",
        data("meshes.npz", b"\x80\x04K\x01."),
        "not readable as .npz",
    ),
    _build(
        "an archive without positions",
        f"{SMALL} source.root=meshes.npz",
        lambda: np.savez("meshes.npz", F=BODY.F),
        "it needs positions V_0",
    ),
    _build(
        "FAUST without registrations",
        "defaust build source=faust source.root=meshes out=out",
        folder("meshes"),
        "meshes",
    ),
]
TAKEN = [
    Case("build: a full disk", _full_disk, shapes("a0", "a1", "b0", "b1"), leaves=("out",)),
    Case(
        "build: names in other scripts",
        f"{SMALL} \"source.root='мешы'\" \"out='体'\"",
        both(shapes("a", "b"), lambda: Path("meshes").rename("мешы")),
        leaves=("体", "мешы"),
        holds=lambda: _no_faults("体"),
    ),
    Case("dataset, verify: a sound one", VERIFY, dataset),
    Case("dataset, info: a sound one", INFO, dataset),
    Case("dataset, run: a sound one", RUN, dataset, leaves=("out",)),
]


def _no_faults(out: str) -> None:
    assert run(f"defaust verify '{out}'")[0] == 0


def _matlab() -> None:
    """TOSCA's format; in the second file the struct is announced as a sparse matrix, which ends SciPy."""
    from scipy.io import savemat

    Path("meshes").mkdir()
    columns = {axis: BODY.V[:, c : c + 1] for c, axis in enumerate("XYZ")}
    for name in ("a", "b"):
        savemat(f"meshes/{name}.mat", {"surface": {**columns, "TRIV": BODY.F + 1}})
    content = bytearray(Path("meshes/b.mat").read_bytes())
    assert content[144] == 2
    content[144] = 5
    Path("meshes/b.mat").write_bytes(content)


def _build_refused_leaves() -> list[Case]:
    """A build whose subject fails has begun: its recipe stays, for the next."""
    cases = []
    for name, given, words in (
        ("a mesh of garbage", both(shapes("a", "b"), garbage("meshes/b.ply")), "b.ply"),
        ("a cut mesh", both(shapes("a", "b"), cut("meshes/b.ply", 0.5)), "b.ply"),
        ("a MATLAB file that ends its reader", _matlab, "b.mat: not readable as .mat"),
        (
            "meshes of other counts",
            both(shapes("a", "b"), lambda: write_mesh("meshes/b.ply", np.eye(3), [[0, 1, 2]])),
            "b.ply",
        ),
    ):

        def holds(words: str = words) -> None:
            code, out, err = run(SMALL)
            assert (code, out) == (2, "") and err.startswith("error: ") and err.count("\n") == 1, err
            assert words in err, err
            left = sorted(str(p) for p in Path("out").rglob("*") if p.is_file())
            assert left in ([], ["out/.build/recipe.json"]), left

        cases.append(Case(f"build: {name}", holds, given, leaves=("out",)))
    return cases


CASES = [*RECORDS, *FILES, *BUILDS, *TAKEN, *_build_refused_leaves()]

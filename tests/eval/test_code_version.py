"""The version of the code behind a row: which edits change it, and which end a run."""

import sys

import pytest
from eval_cases import bumpy_task, write_theirs

import eval.run.attempt as attempt_module
import sshade
from eval.installation import PACKAGES
from eval.rows.store import run_folders
from eval.run import code
from eval.run.run import run

TARGET = "ours.method.method"
FILES = {
    "ours/__init__.py": """
from importlib import import_module
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from ours.lazy import solve
    from ours.other import unneeded
def __getattr__(name):
    return getattr(import_module({"solve": "ours.lazy", "unneeded": "ours.other"}[name]), name)
""",
    "ours/method.py": '''
"""A method."""
from typing import TYPE_CHECKING
import ours.absolute
from ours import solve
from ours.package.module import helper
if TYPE_CHECKING:
    from ours.hints import Hint
def method(task):
    """Deform."""
    from .late import finish
    return finish(task)
''',
    "ours/package/__init__.py": "ORDER = 1\n",
    "ours/package/module.py": '"""Help."""\nfrom ..far import FAR\ndef helper():\n    return FAR\n',
    "ours/far.py": "FAR = 1\ndef __getattr__(name):\n    return FAR\n",
    **{f"ours/{name}.py": "VALUE = 1\n" for name in ("absolute", "hints", "late", "lazy", "other")},
}


def forget() -> None:
    """Forget all files that were read except the project's files, like a new process."""
    for cached in (code.places, code._files, code._of_program):
        cached.cache_clear()
    for name in [name for name in sys.modules if name.split(".")[0] in ("ours", "theirs", "beside", "far")]:
        del sys.modules[name]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Make a folder on Python's path with the package `ours`, which counts as a package of the project.

    Files of the folder are parsed again after `forget`; files of the project are parsed once for all tests.
    """
    once = code._parsed
    again = {True: once, False: once.__wrapped__}
    monkeypatch.setattr(code, "_parsed", lambda path, root: again[root == PACKAGES](path, root))
    for place, text in FILES.items():
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(code, "OWN", code.OWN | {"ours"})
    forget()
    yield tmp_path
    forget()


@pytest.mark.parametrize(
    ("place", "old", "new", "changes"),
    [
        ("method.py", '"""A method."""', '"""A better method."""', False),
        ("method.py", '    """Deform."""\n', "", False),
        ("method.py", "    return finish(task)", "    # why\n    return  finish( task )", False),
        ("package/module.py", "def helper", "\n\ndef helper", False),
        ("method.py", "return finish(task)", "return task", True),
        ("package/module.py", "return FAR", "return -FAR", True),
        ("package/__init__.py", "1", "2", True),
        ("absolute.py", "1", "2", True),
        ("far.py", "1", "2", True),
        ("late.py", "1", "2", True),
        ("lazy.py", "1", "2", True),
        ("other.py", "1", "2", False),
        ("hints.py", "1", "2", False),
        ("__init__.py", "from importlib", "CONSTANT = 1\nfrom importlib", False),
    ],
)
def test_a_version_follows_the_code_of_imported_modules(folder, place, old, new, changes):
    before = code.code_version([TARGET])
    text = (folder / "ours" / place).read_text()
    assert old in text
    (folder / "ours" / place).write_text(text.replace(old, new))
    forget()
    assert (code.code_version([TARGET]) != before) == changes


def test_a_lazy_name_stands_for_the_module_that_defines_it(folder):
    (folder / "theirs.py").write_text("import ours\ndef method(task):\n    return ours.solve(task)\n")
    assert {"ours/lazy.py", "theirs.py"} <= code.loaded_code(["theirs.method"]).keys()
    assert not {"ours/other.py", "ours/__init__.py"} & code.loaded_code(["theirs.method"]).keys()
    for name in sshade.__all__:
        home = getattr(sshade, name).__module__.replace(".", "/")
        assert f"{home}.py" in code.loaded_code([f"sshade.{name}"])


def test_libigls_rows_do_not_depend_on_our_energy_and_pipeline():
    places = code.loaded_code(["baselines.arap.arap"])
    assert {"baselines/arap.py", "sshade/problem/task.py", "eval/run/attempt.py"} <= places.keys()
    parts = ("sshade/method/", "sshade/proxy/", "sshade/proxy/", "sshade/solver/terms/")
    assert not [place for place in places if place.startswith(parts)]
    ours = code.loaded_code(["sshade.deform"])
    assert all(any(place.startswith(part) for place in ours) for part in parts)


# The tests below run a user's method, which is in no package of the project.


@pytest.fixture
def theirs(folder):
    """Write a user's package, which a test may change."""
    return write_theirs(folder)


THEIRS = {"_target_": "theirs.method.method"}


@pytest.mark.parametrize(
    ("change", "runs_again"),
    [
        (lambda package: (package / "README.md").write_text("changed"), False),
        (lambda package: (package / "helper.py").write_text("FACTOR = 2.0  # changed\n"), False),
        (lambda package: (package.parent / "unused.py").write_text("UNUSED = 1\n"), False),
        (lambda package: (package / "helper.py").write_text("FACTOR = 3.0\n"), True),
        (lambda package: (package / "new.py").write_text("NEW = 1\n"), True),
        (lambda package: (package.parent / "far.py").write_text("FAR = 2\n"), True),
    ],
    ids=["text", "comment", "unused", "code", "new file", "beside"],
)
def test_the_key_follows_the_files_of_a_users_method(theirs, tmp_path, change, runs_again):
    assert not run(bumpy_task(level=2), THEIRS, name="t", root=tmp_path / "runs").found
    change(theirs)
    forget()
    assert bool(run(bumpy_task(level=2), THEIRS, name="t", root=tmp_path / "runs").found) != runs_again
    assert not {"json/__init__.py", "numpy/__init__.py"} & code.loaded_code(["theirs.method.method"]).keys()


@pytest.mark.parametrize("place", ["theirs/helper.py", "far.py"])
@pytest.mark.parametrize("removed", [False, True])
def test_an_edit_between_runs_ends_them(theirs, tmp_path, place, removed):
    first = run(bumpy_task(level=2), THEIRS, name="t", root=tmp_path / "runs")
    path = tmp_path / place
    path.write_text(f"# A comment.\n{path.read_text()}")
    assert run(bumpy_task(level=2), THEIRS, name="t", root=tmp_path / "runs").found
    path.unlink() if removed else path.write_text("FACTOR = FAR = 3.0\n")
    for method in (THEIRS, {**THEIRS, "edit": "#"}):  # even if the row exists already
        with pytest.raises(code.CodeChanged, match=f"{place} has changed since the command began"):
            run(bumpy_task(level=2), method, name="t", root=tmp_path / "runs")
    assert run_folders(tmp_path / "runs") == [first.folder]


@pytest.mark.parametrize("fresh", [False, True])
def test_an_edit_during_a_run_leaves_no_row(theirs, tmp_path, fresh):
    with pytest.raises(code.CodeChanged, match="theirs/helper.py has changed"):
        run(bumpy_task(), {**THEIRS, "edit": "X = 1"}, name="t", root=tmp_path / "runs", fresh=fresh)
    assert not (tmp_path / "runs").exists()


def test_the_projects_files_must_be_those_of_the_start(folder, monkeypatch):
    monkeypatch.setattr(code, "PACKAGES", folder)
    monkeypatch.setattr(code, "RUNNER", ())
    path = folder / "ours" / "late.py"
    monkeypatch.setitem(code._BEGUN, path, (0, 0))  # written after the start, before it was parsed
    with pytest.raises(code.CodeChanged, match="ours/late.py has changed"):
        code.code_version([TARGET])


def test_an_edit_of_the_metrics_ends_the_runs(tmp_path, monkeypatch):
    path = tmp_path / "metric.py"
    path.write_text("X = 1\n")
    monkeypatch.setitem(code.MEASURES, "eval/metrics/metric.py", code._read(path, "eval/metrics/metric.py"))
    code.require_unchanged([])
    path.write_text("X = 2\n")
    with pytest.raises(code.CodeChanged, match="eval/metrics/metric.py has changed"):
        code.require_unchanged([])


def test_a_fresh_process_with_other_code_gives_no_row(tmp_path, monkeypatch):
    loaded = code.loaded_code(["eval_cases.stretching"]) | {"sshade/problem/task.py": "another"}
    monkeypatch.setattr(attempt_module, "loaded_code", lambda functions: loaded)
    with pytest.raises(code.CodeChanged, match="sshade/problem/task.py has changed"):
        run(bumpy_task(), {"_target_": "eval_cases.stretching"}, name="a", root=tmp_path / "runs", fresh=True)
    assert not (tmp_path / "runs").exists()

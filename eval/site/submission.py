"""Results that others hand in for a track, read as a stranger's: a folder with

- ``submission.yaml``: ``name`` of the method, ``track``, ``authors``, ``code`` (where it is, https) and,
  if there are such, ``paper`` and ``note``;
- ``method.yaml``: what ``sshade-eval run`` ran it by;
- ``rows.csv``: what ``sshade-eval collect`` made of all runs;
- ``runs``, if given: the run folders with their vertices, which are then measured again.

Nothing that a submission holds is ever called: tasks are loaded by what the project's own rows say.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from eval.metrics import Task, measure
from eval.rows.csv_rows import read_rows
from eval.rows.splits import HELD_OUT, split_of
from eval.rows.store import VALID, Row, read_row, read_vertices, run_folders
from eval.run.code import METRICS
from eval.run.recall import load_task
from eval.site.tracks import Track
from sshade.errors import InputError
from sshade.progress import Progress, silent

#: Facts that ``submission.yaml`` must give, and may.
NEEDED, ALLOWED = ("name", "track", "authors", "code"), ("paper", "note")
#: Letters of a fact, and bytes of a file of facts, at most.
LETTERS, BYTES = 500, 65_536
#: How far a measure of stored vertices, which are single precision, may be from the reported one.
RELATIVE, ABSOLUTE, COUNTED = 1e-3, 1e-4, 2
#: The files of a task of a dataset, and how they were read.
BY_FILES = (
    "task.meta.checksum",
    "task.meta.raw",
    "task.meta.handles",
    "task.meta.resolution",
    "task.handles",
)
#: Measures that are counts.
COUNTS = ("flips", "self_intersections", "collapsed", "zero_area_faces")


class Submission(NamedTuple):
    """What a folder holds, once it was checked.

    Attributes
    ----------
    facts : dict
        Of ``submission.yaml``.
    method : str
        The text of ``method.yaml``.
    rows : list of dict
    remeasured : int
        Runs whose vertices were there and gave what their rows say.
    """

    facts: dict[str, str]
    method: str
    rows: list[Row]
    remeasured: int


def read_facts(folder: Path) -> dict[str, str]:
    """The facts of ``submission.yaml``.

    Raises
    ------
    InputError
        When they are not those that are asked for.
    """
    path = folder / "submission.yaml"
    facts = _yaml(path)
    for name in NEEDED:
        if name not in facts:
            raise InputError(f"{path}: has no {name!r}; needed are {', '.join(NEEDED)}")
    for name, value in facts.items():
        if name not in (*NEEDED, *ALLOWED):
            raise InputError(
                f"{path}: {name!r} is no fact of a submission; they are {', '.join(NEEDED + ALLOWED)}"
            )
        if not isinstance(value, str) or not 0 < len(value) <= LETTERS:
            raise InputError(f"{path}: {name} must be text of at most {LETTERS} letters")
    if not re.fullmatch(r"[a-z][a-z0-9_]{1,40}", facts["name"]):
        raise InputError(f"{path}: the name {facts['name']!r} must be of small letters, digits and _")
    for name in ("code", "paper"):
        if not re.fullmatch(r"https://[^\s<>\"']+", facts.get(name, "https://x")):
            raise InputError(f"{path}: {name} must be an address that begins with https://")
    return facts


def check(folder: Path, track: Track, published: list[Row], *, progress: Progress = silent) -> Submission:
    """Read a submission and hold it against the track's published rows.

    Parameters
    ----------
    folder : path
    track : Track
    published : list of dict
        The project's rows of the track: which cases there are, and what loads them.
    progress : Progress

    Raises
    ------
    InputError
        With what is wrong first.
    """
    facts = read_facts(folder)
    name, path = facts["name"], folder / "rows.csv"
    if facts["track"] != track.name:
        raise InputError(f"{folder}: is for the track {facts['track']}, not {track.name}")
    if name in {row["method.name"] for row in published}:
        raise InputError(f"{folder}: {name} is the name of a method of the project; choose another")
    settings = _yaml(folder / "method.yaml")
    rows = [row for row in read_rows(path) if row["status"] != "missing"]
    official = {row["task.name"]: row for row in published if row["status"] in VALID}
    _check_one_method(path, rows, name, settings)
    _check_code(path, rows, {row.get("env.version.evaluator") for row in published} - {None})
    for row in rows:
        _check_row(f"{path}: the row of {row['task.name']}, seed {row['seed']},", row, official)
    _check_complete(path, rows, official)
    remeasured = 0
    if (folder / "runs").is_dir():
        remeasured = _remeasure(folder / "runs", rows, official, progress)
    # By the track's own name for it, so that a case of another processor is the same one in tables.
    rows = [row | {"task.checksum": official[row["task.name"]]["task.checksum"]} for row in rows]
    return Submission(facts, (folder / "method.yaml").read_text(encoding="utf-8"), rows, remeasured)


def _yaml(path: Path) -> dict[str, Any]:
    """A mapping of a small YAML file."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > BYTES:
        raise InputError(f"{path}: has more than {BYTES} bytes")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not YAML ({' '.join(str(error).split())})") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a mapping of names to values")
    return content


def _check_one_method(path: Path, rows: list[Row], name: str, settings: Mapping[str, Any]) -> None:
    """All rows are of one method, configuration and version, measured by today's metrics."""
    if not rows:
        raise InputError(f"{path}: holds no rows of runs")
    for row in rows:
        if row["method.name"] != name:
            raise InputError(f"{path}: has rows of {row['method.name']}, and the submission is of {name}")
        if row.get("method.target") != settings.get("_target_"):
            raise InputError(
                f"{path}: rows were made by {row.get('method.target')}, and method.yaml names "
                f"{settings.get('_target_')}"
            )
    several = {
        "method.hash": "configurations",
        "env.version.code": "versions of the code",
        "env.version.metrics": "versions of the metrics",
    }
    for column, what in several.items():
        if len({row.get(column) for row in rows}) > 1:
            raise InputError(f"{path}: has rows of several {what}; run the older ones again")
    row = rows[0]
    if row.get("env.version.metrics") != METRICS:
        raise InputError(f"{path}: was measured by other metrics than those of this version; remeasure it")


def _check_code(path: Path, rows: list[Row], known: Set[Any]) -> None:
    """Rows are from a commit of the evaluator, or of a wheel, which has none, of the track's version."""
    for row in rows:
        commit, modified = row.get("env.commit"), row.get("env.modified")
        committed = modified is False and re.fullmatch("[0-9a-f]{40}", str(commit))
        known_wheel = not commit and modified is None and row.get("env.version.evaluator") in known
        if not committed and not known_wheel:
            raise InputError(
                f"{path}: the row of {row['task.name']} is of a modified tree, or of no commit and another "
                "version of the code than the track's rows; run it again in a clean clone of the project, or "
                "with a wheel of that version"
            )
        if not row.get("env.machine_id"):
            raise InputError(
                f"{path}: the row of {row['task.name']} does not say which machine it was made on"
            )


def _check_row(where: str, row: Row, official: Mapping[str, Row]) -> None:
    """A row is of a case of the track, unchanged, and has all of its measures, or says why not."""
    case = official.get(row["task.name"])
    if case is None:
        raise InputError(f"{where} is of no case of the track")
    for column in ("task.vertices", *(() if _of_equal_files(row, case) else ("task.checksum",))):
        if row.get(column) != case[column]:
            raise InputError(
                f"{where} is of another task of this name ({column} {row.get(column)}, the track's "
                f"{case[column]}); build the dataset again"
            )
    if row["status"] not in VALID:
        if not row.get("reason"):
            raise InputError(f"{where} has no result and gives no reason")
        return
    for column in (name for name in case if name.startswith("metric.") and case[name] is not None):
        value = row.get(column)
        if value is None or not math.isfinite(value) or value < 0:
            raise InputError(f"{where} has a {column} of {value}")
    if not (row.get("seconds.total") or 0) > 0:
        raise InputError(f"{where} does not say how long it took")


def _of_equal_files(row: Row, case: Row) -> bool:
    """Whether two rows are of tasks that were read from equal files in the same way.

    What a method saw of them may differ in the last digits: targets that turn with their group come of a
    singular value decomposition, whose rounding is that of the processor.
    """
    return case.get("task.meta.checksum") is not None and all(row.get(c) == case.get(c) for c in BY_FILES)


def _check_complete(path: Path, rows: list[Row], official: Mapping[str, Row]) -> None:
    """Each seed has every held-out case once."""
    runs = Counter((row["task.name"], row["seed"]) for row in rows)
    (task, seed), count = runs.most_common(1)[0]
    if count > 1:
        raise InputError(f"{path}: has {count} rows of {task}, seed {seed}")
    needed = [name for name in official if split_of(name) == HELD_OUT]
    for seed in sorted({row["seed"] for row in rows}):
        missing = [name for name in needed if (name, seed) not in runs]
        if missing:
            raise InputError(
                f"{path}: seed {seed} lacks {len(missing)} of the track's {len(needed)} held-out cases, "
                f"such as {missing[0]}; a run that failed has a row, too"
            )


def _remeasure(runs: Path, rows: list[Row], official: Mapping[str, Row], progress: Progress) -> int:
    """Measure the vertices that are there again; how many runs had them."""
    by_key = {row["key"]: row for row in rows}
    found = [(by_key.get((read_row(folder) or {}).get("key")), folder) for folder in run_folders(runs)]
    for row, folder in found:
        if row is None:
            raise InputError(f"{folder}: is the folder of none of the rows")
    found = [(row, folder) for row, folder in found if row["status"] in VALID]
    found.sort(key=lambda pair: pair[0]["task.name"])
    name, task = "", None
    for done, (row, folder) in enumerate(found):
        progress("measuring again", done, len(found), row["task.name"])
        if row["task.name"] != name:
            name, task = row["task.name"], _task(row, official[row["task.name"]])
        values = measure(task, read_vertices(folder, n=row["task.vertices"]))
        for measure_name, value in values.items():
            _check_measure(folder, measure_name, value, row.get(f"metric.{measure_name}"))
    return len(found)


def _task(row: Row, case: Row) -> Task:
    """The task of a case, as it is on the track's processor or on that of the row."""
    try:
        return load_task(case)
    except InputError:
        if row["task.checksum"] == case["task.checksum"]:
            raise
    return load_task(case | {"task.checksum": row["task.checksum"]})


def _check_measure(folder: Path, name: str, value: float | None, reported: float | None) -> None:
    if value is None and reported is None:
        return
    near = COUNTED if name in COUNTS else ABSOLUTE
    if value is None or reported is None or not math.isclose(value, reported, rel_tol=RELATIVE, abs_tol=near):
        raise InputError(f"{folder}: its vertices have a {name} of {value}, and its row says {reported}")

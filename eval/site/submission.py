"""Hand in results for the leaderboard: ``sshade-eval submit FOLDER``.

The folder holds submission.yaml (name, track, authors, code), method.yaml, rows.csv and optionally the run
folders with the vertices, which are measured again. Rows must come from one configuration, one version and a
clean commit, and cover every held-out case of the track once for each seed. Unless --check is given, the
files without vertices are copied to submissions/NAME for a pull request. See CONTRIBUTING.md.
"""

from __future__ import annotations

import argparse
import math
import re
from collections import Counter
from collections.abc import Mapping, Set
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from eval.metrics import Task
from eval.rows.csv_rows import read_rows
from eval.rows.files import copy_file
from eval.rows.frame import records
from eval.rows.splits import HELD_OUT, split_of
from eval.rows.store import VALID, Row, read_row, run_folders
from eval.run.code import METRICS
from eval.run.recall import load_task, measured_again
from eval.site.tracks import Track, published, read_tracks
from sshade.cli.console import progress_bar
from sshade.errors import InputError
from sshade.progress import Progress, silent

#: Folder of committed submissions, and the files that are copied there.
SUBMISSIONS, FILES = Path("submissions"), ("submission.yaml", "method.yaml", "rows.csv")
#: Required and optional keys of ``submission.yaml``.
NEEDED, ALLOWED = ("name", "track", "authors", "code"), ("paper", "note")
#: Largest number of letters of a value, and of bytes of a file.
LETTERS, BYTES = 500, 65_536
#: Tolerances of measures of stored vertices, which have single precision: relative, absolute, and of counts.
RELATIVE, ABSOLUTE, COUNTED = 1e-3, 1e-4, 2
#: Columns that identify the files of a task and the way they were read.
BY_FILES = (*(f"task.meta.{fact}" for fact in ("checksum", "raw", "handles", "resolution")), "task.handles")
#: Measures that are counts.
COUNTS = ("flips", "self_intersections", "collapsed", "zero_area_faces")
#: Absolute tolerance of `detail` in degrees: rounding turns small faces of a flat part that has not moved.
TURNED = 0.05


class Submission(NamedTuple):
    """The contents of a checked folder.

    Attributes
    ----------
    facts : dict
        Contents of ``submission.yaml``.
    method : str
        Text of ``method.yaml``.
    rows : list of dict
    remeasured : int
        Number of runs whose vertices were measured again.
    """

    facts: dict[str, str]
    method: str
    rows: list[Row]
    remeasured: int


def read_facts(folder: Path) -> dict[str, str]:
    """Read ``submission.yaml``.

    Raises
    ------
    InputError
        If a key is missing or unknown, or a value is not as required.
    """
    path = folder / "submission.yaml"
    facts = _yaml(path)
    for name in NEEDED:
        if name not in facts:
            raise InputError(f"{path}: has no {name!r}; required are {', '.join(NEEDED)}")
    for name, value in facts.items():
        if name not in (*NEEDED, *ALLOWED):
            raise InputError(f"{path}: {name!r} is unknown; a submission has {', '.join(NEEDED + ALLOWED)}")
        if not isinstance(value, str) or not 0 < len(value) <= LETTERS:
            raise InputError(f"{path}: {name} must be text of at most {LETTERS} letters")
    if not re.fullmatch(r"[a-z][a-z0-9_]{1,40}", facts["name"]):
        raise InputError(f"{path}: the name {facts['name']!r} must consist of small letters, digits and _")
    for name in ("code", "paper"):
        if not re.fullmatch(r"https://[^\s<>\"']+", facts.get(name, "https://x")):
            raise InputError(f"{path}: {name} must be an address that begins with https://")
    return facts


def check(folder: Path, track: Track, published: list[Row], *, progress: Progress = silent) -> Submission:
    """Read a submission and compare it with the published rows of the track.

    A submission is not trusted. No function or program that it names runs: tasks are loaded as the project's
    rows say. Its folder has

    - ``submission.yaml``: ``name`` of the method, ``track``, ``authors``, ``code`` (an https address), and
      optionally ``paper`` and ``note``;
    - ``method.yaml``: the configuration of the method;
    - ``rows.csv``: the rows that ``sshade-eval collect`` made from all runs;
    - ``runs``, optional: the run folders with their vertices, which are measured again.

    Parameters
    ----------
    folder : path
    track : Track
    published : list of dict
        The project's rows of the track, which define its cases.
    progress : Progress

    Raises
    ------
    InputError
        With the first problem.
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
    _check_settings(folder / "method.yaml", rows[0], settings)
    known = {row.get("env.version.evaluator") for row in published} - {None}
    for row in rows:
        where = f"{path}: the row of {row['task.name']}, seed {row['seed']},"
        _check_origin(where, row, known)
        _check_row(where, row, official)
    _check_complete(path, rows, official)
    remeasured = 0
    if (folder / "runs").is_dir():
        remeasured = _remeasure(folder / "runs", rows, official, progress)
    # Tables identify a case by the checksum of the track, which may differ from that of another processor.
    rows = [row | {"task.checksum": official[row["task.name"]]["task.checksum"]} for row in rows]
    return Submission(facts, (folder / "method.yaml").read_text(encoding="utf-8"), rows, remeasured)


def _yaml(path: Path) -> dict[str, Any]:
    """Read a mapping from a small YAML file."""
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
    """Require rows of one method, configuration and version, measured by the current metrics."""
    if not rows:
        raise InputError(f"{path}: holds no rows of runs")
    if "_target_" not in settings:
        raise InputError(f"{path.with_name('method.yaml')}: has no _target_, the dotted name of the function")
    same_as = {"method.name": name, "method.target": settings["_target_"]}
    if "command" in settings:  # of an external program
        same_as["method.command"] = str(settings["command"])
    for column, expected in same_as.items():
        for found in {row.get(column) for row in rows} - {expected}:
            raise InputError(f"{path}: has rows of {found}, and the submission is of {expected}")
    same = {"method.hash": "configurations"}
    same |= {f"env.version.{part}": f"versions of the {part}" for part in ("code", "metrics")}
    for column, what in same.items():
        if len({row.get(column) for row in rows}) > 1:
            raise InputError(f"{path}: has rows of several {what}; run the older ones again")
    if rows[0].get("env.version.metrics") != METRICS:
        raise InputError(
            f"{path}: was measured by another version of the metrics; run `sshade-eval remeasure`, then "
            "`sshade-eval collect`"
        )


def _check_settings(path: Path, row: Row, settings: Mapping[str, Any]) -> None:
    """Require that plain settings of the method are settings of its rows; texts may be interpolations."""
    for name, value in settings.items():
        column = f"method.{name}"
        if isinstance(value, (bool, int, float)) and row.get(column, value) != value:
            raise InputError(f"{path}: says {name}: {value}, and rows.csv has {row[column]}")


def _check_origin(where: str, row: Row, known: Set[Any]) -> None:
    """Require a clean commit, or a wheel of the track's version, which has no commit."""
    commit, modified = row.get("env.commit"), row.get("env.modified")
    committed = modified is False and re.fullmatch("[0-9a-f]{40}", str(commit))
    known_wheel = not commit and modified is None and row.get("env.version.evaluator") in known
    if not committed and not known_wheel:
        raise InputError(
            f"{where} comes from a checkout with changes that are not committed, or from no commit and "
            "another version of the code than the track; run it again in a clean clone of the project, or "
            "with a wheel of the track's version"
        )
    if not row.get("env.machine_id"):
        raise InputError(f"{where} names no machine; run it again")


def _check_row(where: str, row: Row, official: Mapping[str, Row]) -> None:
    """Require an unchanged case of the track with all of its measures, or a reason why it has no measures."""
    case = official.get(row["task.name"])
    if case is None:
        raise InputError(f"{where} is not a case of the track")
    for column in ("task.vertices", *(() if _of_equal_files(row, case) else ("task.checksum",))):
        if row.get(column) != case[column]:
            raise InputError(
                f"{where} is of another task of this name ({column} {row.get(column)}, the track has "
                f"{case[column]}); build the dataset again"
            )
    if row["status"] not in VALID:
        if not row.get("reason"):
            raise InputError(f"{where} has no result and gives no reason")
        return
    for column in (name for name in case if name.startswith("metric.") and case[name] is not None):
        value = row.get(column)
        # A face without area in the result has an infinite distortion.
        infinite = value is None and column.startswith("metric.distortion") and row.get("metric.collapsed")
        if not infinite and (value is None or not math.isfinite(value) or value < 0):
            raise InputError(f"{where} has a {column} of {value}")
    if not (row.get("seconds.total") or 0) > 0:
        raise InputError(f"{where} does not say how long it took")


def _of_equal_files(row: Row, case: Row) -> bool:
    """Whether two rows are of tasks that were read from equal files in the same way.

    The tasks may differ in the last digits: targets come from a singular value decomposition, whose rounding
    depends on the processor.
    """
    return case.get("task.meta.checksum") is not None and all(row.get(c) == case.get(c) for c in BY_FILES)


def _check_complete(path: Path, rows: list[Row], official: Mapping[str, Row]) -> None:
    """Require every held-out case once for each seed."""
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
                f"such as {missing[0]}; failed runs need a row as well"
            )


def _task(official: Mapping[str, Row], row: Row) -> Task:
    """Load the task of a row's case, with the checksum of the track or of the row's processor."""
    case = official[row["task.name"]]
    try:
        return load_task(case)
    except InputError:
        if row["task.checksum"] == case["task.checksum"]:
            raise
    return load_task(case | {"task.checksum": row["task.checksum"]})


def _agree(name: str, value: float | None, row: Row) -> bool:
    """Whether a measure of vertices in single precision can be the measure in a row."""
    reported = row.get(f"metric.{name}")
    if value is None or reported is None:
        return value is reported
    near, relative = COUNTED if name in COUNTS else TURNED if name == "detail" else ABSOLUTE, RELATIVE
    if name.startswith("distortion"):
        # 1 / s^2 of a face that is squashed by s: the rounding of s counts 1 / s times as much. A mean may
        # consist of a single such face.
        worst = row.get("metric.distortion_max") if name == "distortion" else reported
        relative *= max(1.0, math.sqrt(worst or reported))
    return math.isclose(value, reported, rel_tol=relative, abs_tol=near)


def _remeasure(runs: Path, rows: list[Row], official: Mapping[str, Row], progress: Progress) -> int:
    """Measure the vertices of the run folders again; return the number of runs."""
    by_key = {row["key"]: row for row in rows}
    found = [(by_key.get((read_row(folder) or {}).get("key")), folder) for folder in run_folders(runs)]
    for row, folder in found:
        if row is None:
            raise InputError(f"{folder}: belongs to no row of rows.csv")
    found = [(row, folder) for row, folder in found if row["status"] in VALID]
    load = partial(_task, official)
    for row, folder, values in measured_again(found, stage="measuring again", progress=progress, load=load):
        for name, value in values.items():
            if not _agree(name, value, row):
                reported = row.get(f"metric.{name}")
                raise InputError(f"{folder}: the vertices have {name} {value}, and the row says {reported}")
    return len(found)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="the submission")
    parser.add_argument("--check", action="store_true", help="check the submission, and write nothing")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    tracks, facts = read_tracks(), read_facts(options.folder)
    if facts["track"] not in tracks:
        raise InputError(f"{facts['track']!r} is no track; the tracks are {', '.join(tracks)}")
    track = tracks[facts["track"]]
    rows = records(published(track))
    with progress_bar() as progress:
        found = check(options.folder, track, rows, progress=progress)
    seeds = len({row["seed"] for row in found.rows})
    measured = "none with vertices: measures are as reported"
    if found.remeasured:
        measured = f"{found.remeasured} measured again from their vertices"
    runs = f"{len(found.rows)} runs, {seeds} seed{'s' * (seeds > 1)}"
    print(f"{facts['name']} on {track.name}: {runs}, {measured}")  # noqa: T201
    if not options.check:
        target = SUBMISSIONS / facts["name"]
        for name in FILES:
            copy_file(options.folder / name, target / name)
        print(f"copied to {target}; commit it, and open a pull request")  # noqa: T201
    return 0

"""Builds a DeFAUST folder from a source, subject by subject, and resumes an unfinished one."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from defaust.build.lock import LOCK, sole_builder
from defaust.build.options import BuildOptions
from defaust.build.subject import UnusableError
from defaust.build.workers import build_subjects
from defaust.folder.card import render_card
from defaust.folder.layout import (
    CARD,
    DATASET,
    FORMAT,
    WORK,
    checksum,
    dump,
    sha256,
    subject_folder,
    write_text,
)
from defaust.folder.record import FINISHED, read_dataset, read_json, read_record
from defaust.sources.source import Source
from sshade import InputError
from sshade.io.files import make_folder
from sshade.progress import Progress, silent
from sshade.threads import available_cpus, number_of_workers

log = logging.getLogger(__name__)

#: In WORK: what determines the result.
RECIPE = "recipe.json"
#: Packages whose version can change the result.
TOOLS = ("numpy", "scipy", "pymeshlab")


def build(
    source: Source,
    out: str | os.PathLike[str],
    *,
    options: BuildOptions,
    strict: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Build a DeFAUST folder, or what is missing of it.

    A mesh that cannot be used is left out, and with it its pose, or its subject where it is the rest
    mesh or no pose is left: a warning says so, and dataset.json keeps the reason.

    A rerun with the same source and options keeps the subjects that are
    complete and intact; the result does not depend on interruptions nor on the
    number of workers.

    Parameters
    ----------
    source : Source
    out : path
        The folder; its parent must exist.
    options : BuildOptions
    strict : bool
        Stop at the first mesh that cannot be used.
    workers : int, optional
        Processes; by default one for each CPU that this process may use. 1 works in this process.
    progress : Progress

    Returns
    -------
    dict
        The content of dataset.json.

    Raises
    ------
    InputError
        When `out` holds something else or a dataset built with other options,
        when another process builds there, when no subject can be built, or when one cannot
        and the build is `strict`.
    """
    out = Path(out)
    workers = number_of_workers(workers, default=available_cpus())
    recipe = _recipe(source, options)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder")
    with sole_builder(out):
        _prepare(out, recipe)
        subjects = recipe["build"]["subjects"]
        _tell(recipe["source"], strict=strict)
        done = _finished(out, subjects)
        if strict:
            done = {s: record for s, record in done.items() if "left_out" not in record}
        unusable: dict[int, UnusableError] = {}
        missing = [s for s in subjects if s not in done]
        log.info("%d of %d subjects are there already", len(done), len(subjects))
        progress("subjects", len(done), len(subjects))
        workers = min(workers, max(1, len(missing)))
        for subject, record in build_subjects(
            source, out, subjects=missing, options=options, strict=strict, workers=workers, progress=progress
        ):
            if isinstance(record, UnusableError):
                unusable[subject] = record
                log.warning("left out: %s", record)
            else:
                done[subject] = record
                write_text(_record_path(out, subject), dump(record))
                for pose in record.get("left_out", ()):
                    log.warning("left out: subject %d, pose %d: %s", subject, pose["pose"], pose["reason"])
            progress("subjects", len(done) + len(unusable), len(subjects), f"subject {subject} done")
        if not done:
            raise unusable[subjects[0]]
        return _finish(out, recipe, records=[done[s] for s in subjects if s in done], unusable=unusable)


def _tell(source: dict[str, Any], *, strict: bool) -> None:
    """Say which classes of a source are not taken; InputError where that was not to be and `strict`."""
    if source.get("without"):
        log.warning(
            "left out: %s, as source.without says; source.classes=[...] chooses others",
            ", ".join(source["without"]),
        )
    for name, why in source.get("left_out", {}).items():
        if strict:
            raise InputError(f"{name}: {why}; remove it, or build with strict=false")
        log.warning("left out: %s: %s", name, why)


def _recipe(source: Source, options: BuildOptions) -> dict[str, Any]:
    """What determines the result: the first part of dataset.json, as it reads back from JSON."""
    for subject in options.subjects or ():
        if subject not in source.subjects:
            raise InputError(
                f"the source {source.name} has no subject {subject}; it has {list(source.subjects)}"
            )
    subjects = source.subjects if options.subjects is None else options.subjects
    files = source.checksums(subjects)
    build = asdict(options) | {"subjects": list(subjects), "window": list(options.window)}
    return {
        "format": FORMAT,
        "name": f"defaust-{source.name}",
        "source": {"name": source.name, **source.provenance, **({"files": dict(files)} if files else {})},
        "build": build,
        "tools": {name: metadata.version(name) for name in TOOLS},
        "landmarks": list(source.landmark_names),
        "poses": {
            str(s): [
                {"pose": k, "name": p.name, "aligned": p.aligned, "landmarks": list(p.landmarks)}
                for k, p in enumerate(source.poses(s), start=1)
            ]
            for s in subjects
        },
    }


def _prepare(out: Path, recipe: dict[str, Any]) -> None:
    """Check that what is in the folder was built by the same recipe, and begin or go on with it."""
    started, finished = out / WORK / RECIPE, out / DATASET
    others = [path for path in out.iterdir() if path.name not in (LOCK, WORK)]
    if others and not started.is_file() and not finished.is_file():
        raise InputError(f"{out} is not empty and holds no DeFAUST build; give another out")
    # A recipe under which no subject was finished binds nobody.
    begun = any((out / WORK).glob("subject_*.json"))
    for path in (started, finished) if begun else (finished,):
        if path.is_file():
            before = read_json(path)
            if not isinstance(before, dict):
                raise InputError(f"{path}: not a record of a build; delete the folder")
            difference = _difference({key: before.get(key) for key in recipe}, recipe)
            if difference:
                raise InputError(
                    f"{out} was built with another configuration: {difference}; "
                    "give another out, or delete the folder"
                )
    make_folder(out / WORK)
    for folder in (out, out / WORK):
        for path in folder.glob(".*.partial*"):  # what a killed build left half written
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
    write_text(started, dump(recipe))


def _difference(before: Any, now: Any, *, where: str = "") -> str:
    """First difference of two JSON documents, in words; empty if there is none."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*now, *(k for k in before if k not in now)]:
            found = _difference(before.get(key), now.get(key), where=f"{where}.{key}" if where else key)
            if found:
                return found
        return ""
    return "" if before == now else f"{where} was {before!r} and is now {now!r}"


def _record_path(out: Path, subject: int) -> Path:
    return out / WORK / f"{subject_folder(subject)}.json"


def _finished(out: Path, subjects: Sequence[int]) -> dict[int, dict[str, Any]]:
    """Records of the subjects whose files are all there and intact."""
    records: dict[int, dict[str, Any]] = {}
    if (out / DATASET).is_file():  # a finished dataset to be mended
        document = read_dataset(out, intact=False)
        for record in document["subjects"]:
            inside = f"{subject_folder(record['subject'])}/"
            files = {name: e for name, e in document["files"].items() if name.startswith(inside)}
            records[record["subject"]] = record | {"files": files}
    for subject in subjects:
        path = _record_path(out, subject)
        try:
            if path.is_file():
                records[subject] = read_record(path, FINISHED)
        except InputError as error:
            log.warning("%s: subject %d is built again", error, subject)
            records.pop(subject, None)
    for subject, record in list(records.items()):
        for name, entry in record["files"].items():
            if not (out / name).is_file() or sha256(out / name) != entry["sha256"]:
                log.warning("%s is missing or damaged: subject %d is built again", out / name, subject)
                del records[subject]
                break
    return records


def _finish(
    out: Path,
    recipe: dict[str, Any],
    *,
    records: list[dict[str, Any]],
    unusable: dict[int, UnusableError],
) -> dict[str, Any]:
    """Write the card and dataset.json, and drop what was kept for resuming."""
    files = {name: entry for record in records for name, entry in record["files"].items()}
    subjects = [{key: value for key, value in record.items() if key != "files"} for record in records]
    left_out = [{"subject": s, "reason": str(unusable[s])} for s in sorted(unusable)]
    document = recipe | {"subjects": subjects, **({"left_out": left_out} if left_out else {}), "files": files}
    write_text(out / CARD, render_card(document))
    path = out / CARD
    document["files"] = files | {CARD: {"sha256": sha256(path), "bytes": path.stat().st_size}}
    document["checksum"] = checksum(document)
    write_text(out / DATASET, dump(document))
    shutil.rmtree(out / WORK)
    return document

"""Build a DeFAUST folder from a source, subject by subject, or resume an unfinished build."""

from __future__ import annotations

import logging
import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from defaust.build.doubts import check_registrations
from defaust.build.lock import sole_builder
from defaust.build.options import BuildOptions
from defaust.build.subject import UnusableError
from defaust.build.workers import build_subjects
from defaust.folder import layout
from defaust.folder.card import contradiction_texts, render_card
from defaust.folder.record import read_dataset, read_json
from defaust.sources.source import Source, SourcePose
from sshade import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import available_cpus, number_of_workers

log = logging.getLogger(__name__)

#: File in WORK with everything that determines the result.
RECIPE = "recipe.json"
#: Names of folders of subjects, and of what a killed build leaves.
SUBJECT, LEFTOVER = re.compile(r"subject_\d+"), re.compile(r"\..*\.partial.*")
#: Packages whose versions can change the result.
TOOLS = ("numpy", "scipy", "pymeshlab")


def build(
    source: Source,
    out: str | os.PathLike[str],
    *,
    options: BuildOptions,
    strict: bool = True,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Build a DeFAUST folder, or the missing parts of it.

    Meshes in files are read before anything is written. Without `strict`, a mesh that cannot be used is left
    out with its pose, and an unusable rest mesh leaves out the subject. A warning and dataset.json say why.

    A rerun with the same source and options keeps all complete and intact subjects. The result depends
    neither on interruptions nor on the number of workers.

    Parameters
    ----------
    source : Source
    out : path
        The folder to make or to resume.
    options : BuildOptions
    strict : bool
        Stop at the first mesh that cannot be used, instead of leaving it out.
    workers : int, optional
        Number of processes; by default one for each CPU that this process may use. 1 builds in this process.
    progress : Progress

    Returns
    -------
    dict
        The content of dataset.json.

    Raises
    ------
    InputError
        When `out` holds other files or a dataset with other options, another process builds there, or no
        subject can be built; when two poses of a subject have equal vertices. With `strict`, when any mesh in
        a file cannot be used, or cannot be the subject's; see :mod:`defaust.build.doubts`.
    """
    out = Path(out)
    workers = number_of_workers(workers, default=available_cpus())
    recipe, unusable = _recipe(source, options, strict=strict)
    if len(unusable) == len(recipe["build"]["subjects"]):
        raise next(iter(unusable.values()))
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder")
    _report_left_out(recipe["source"], strict=strict)
    if "files" in recipe["source"] and not (out / layout.DATASET).is_file():
        usable = [subject for subject in recipe["build"]["subjects"] if subject not in unusable]
        check_registrations(source, usable, strict=strict)
    with sole_builder(out):
        _prepare(out, recipe)
        subjects = recipe["build"]["subjects"]
        done = _finished(out, subjects)
        if strict:
            done = {s: record for s, record in done.items() if "left_out" not in record}
        for error in unusable.values():
            log.warning("left out: %s", error)
        missing = [s for s in subjects if s not in done and s not in unusable]
        progress("subjects", len(done), len(subjects))
        workers = min(workers, max(1, len(missing)))
        for subject, record in build_subjects(
            source, out, subjects=missing, options=options, strict=strict, workers=workers
        ):
            if isinstance(record, UnusableError):
                unusable[subject] = record
                log.warning("left out: %s", record)
            else:
                done[subject] = record
                layout.write_text(_record_path(out, subject), layout.dump(record))
                for pose in record.get("left_out", ()):
                    log.warning("left out: subject %d, pose %d: %s", subject, pose["pose"], pose["reason"])
                for text in contradiction_texts(record):
                    log.warning("%s", text)
            progress("subjects", len(done) + len(unusable), len(subjects), f"subject {subject} done")
        if not done:
            raise unusable[subjects[0]]
        return _finish(out, recipe, records=[done[s] for s in subjects if s in done], unusable=unusable)


def _report_left_out(source: dict[str, Any], *, strict: bool) -> None:
    """Warn about data that a source leaves out; with `strict`, raise InputError unless it was configured."""
    if source.get("without"):
        log.warning(
            "left out: %s, as source.without says; source.classes=[...] includes them",
            ", ".join(source["without"]),
        )
    for name, why in source.get("left_out", {}).items():
        if strict:
            raise InputError(f"{name}: {why}; remove it, or build with strict=false")
        log.warning("left out: %s: %s", name, why)


def _recipe(
    source: Source, options: BuildOptions, *, strict: bool
) -> tuple[dict[str, Any], dict[int, UnusableError]]:
    """Everything that determines the result: the first part of dataset.json, as JSON reads it back.

    Also returns the subjects whose poses cannot be read, which have no poses there.
    """
    for subject in options.subjects or ():
        if subject not in source.subjects:
            raise InputError(
                f"the source {source.name} has no subject {subject}; it has {list(source.subjects)}"
            )
    subjects = source.subjects if options.subjects is None else options.subjects
    poses, unusable = dict[int, tuple[SourcePose, ...]](), dict[int, UnusableError]()
    for s in subjects:
        try:
            poses[s] = source.poses(s)
        except InputError as error:
            if strict:
                raise
            poses[s], unusable[s] = (), UnusableError(str(error))
    files = source.checksums(subjects)
    build = asdict(options) | {"subjects": list(subjects), "window": list(options.window)}
    recipe = {
        "format": layout.FORMAT,
        "name": f"defaust-{source.name}",
        "source": {
            "name": source.name,
            **source.provenance,
            **({"files": dict(files)} if files else {}),
        },
        "build": build,
        "tools": {name: metadata.version(name) for name in TOOLS},
        "landmarks": list(source.landmark_names),
        "poses": {
            str(s): [
                {"pose": k, "name": p.name, "aligned": p.aligned, "landmarks": list(p.landmarks)}
                for k, p in enumerate(poses[s], start=1)
            ]
            for s in subjects
        },
    }
    return recipe, unusable


def _prepare(out: Path, recipe: dict[str, Any]) -> None:
    """Check that the folder was built by the same recipe, and begin or resume the build."""
    started, finished = out / layout.WORK / RECIPE, out / layout.DATASET
    others = [
        path for path in out.iterdir() if path.name != layout.WORK and not LEFTOVER.fullmatch(path.name)
    ]
    if others and not started.is_file() and not finished.is_file():
        raise InputError(f"{out} is not empty and holds no DeFAUST build; give another out")
    strange = [path.name for path in others if not SUBJECT.fullmatch(path.name) and path.name != layout.CARD]
    if strange and not finished.is_file():
        raise InputError(f"{out} holds {strange[0]}, which no build has written; give another out")
    # A recipe may be replaced where it has built nothing.
    begun = any((out / layout.WORK).glob("subject_*.json")) or bool(others)
    for path in (started, finished) if begun else (finished,):
        if path.is_file():
            before = read_json(path)
            difference = _difference({key: before.get(key) for key in recipe}, recipe)
            if difference:
                raise InputError(
                    f"{out} was built with another configuration: {difference}; "
                    "give another out, or delete the folder"
                )
    layout.make_folder(out / layout.WORK)
    for folder in (out, out / layout.WORK):
        for path in [path for path in folder.iterdir() if LEFTOVER.fullmatch(path.name)]:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
    layout.write_text(started, layout.dump(recipe))


def _difference(before: Any, now: Any, *, where: str = "") -> str:
    """Describe the first difference of two JSON documents; empty if they are equal."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*now, *(k for k in before if k not in now)]:
            found = _difference(before.get(key), now.get(key), where=f"{where}.{key}" if where else key)
            if found:
                return found
        return ""
    return "" if before == now else f"{where} was {before!r} and is now {now!r}"


def _record_path(out: Path, subject: int) -> Path:
    return out / layout.WORK / f"{layout.subject_folder(subject)}.json"


def _finished(out: Path, subjects: Sequence[int]) -> dict[int, dict[str, Any]]:
    """Records of the subjects whose files are complete and intact."""
    records: dict[int, dict[str, Any]] = {}
    if (out / layout.DATASET).is_file():  # a finished dataset, perhaps with damaged files
        document = read_dataset(out)
        for record in document["subjects"]:
            inside = f"{layout.subject_folder(record['subject'])}/"
            files = {name: e for name, e in document["files"].items() if name.startswith(inside)}
            records[record["subject"]] = record | {"files": files}
    for subject in subjects:
        path = _record_path(out, subject)
        if path.is_file():
            records[subject] = read_json(path)
    for subject, record in list(records.items()):
        for name, entry in record["files"].items():
            if not (out / name).is_file() or layout.sha256(out / name) != entry["sha256"]:
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
    """Write the card and dataset.json, and remove the records for resuming."""
    files = {name: entry for record in records for name, entry in record["files"].items()}
    subjects = [{key: value for key, value in record.items() if key != "files"} for record in records]
    left_out = [{"subject": s, "reason": str(unusable[s])} for s in sorted(unusable)]
    document = recipe | {"subjects": subjects, **({"left_out": left_out} if left_out else {}), "files": files}
    layout.write_text(out / layout.CARD, render_card(document))
    path = out / layout.CARD
    document["files"] = files | {layout.CARD: {"sha256": layout.sha256(path), "bytes": path.stat().st_size}}
    document["checksum"] = layout.checksum(document)
    layout.write_text(out / layout.DATASET, layout.dump(document))
    shutil.rmtree(out / layout.WORK)
    return document

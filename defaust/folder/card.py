"""The dataset card, README.md of a DeFAUST folder: data/card.md filled with the facts of dataset.json."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import resources
from typing import Any

import yaml

from defaust.folder.record import has_regions
from sshade.core.errors import counted


def render_card(document: dict[str, Any]) -> str:
    """Markdown of the card; a pure function of dataset.json without the card's own entry."""
    data = resources.files("defaust") / "data"
    phrases = yaml.safe_load(data.joinpath("card.yaml").read_text(encoding="utf-8"))
    source, build, subjects = (document[key] for key in ("source", "build", "subjects"))
    upsampled = build["target_vertices"] is not None
    poses = [pose for of_subject in document["poses"].values() for pose in of_subject]
    everywhere = [name for name in document["landmarks"] if all(name in pose["landmarks"] for pose in poses)]
    others = [name for name in document["landmarks"] if name not in everywhere]
    regions = has_regions(document)
    facts = {
        "build": build,
        "at_low": " at low resolution" if upsampled else "",
        "where": "At low resolution" if upsampled else "As the registered meshes are used,",
        "of": " (each pose uses some of them)" if others else " of every pose",
        "landmarks": ", ".join(document["landmarks"] if regions else everywhere),
        "more_landmarks": f" Poses that are turned as a whole add {', '.join(others)}." if others else "",
    }
    chosen = phrases["regions" if regions else "landmarks"]
    if source.get("noise_mm", 0) > 0:
        chosen = chosen | phrases["noisy"]
    texts = {key: text.format_map(facts) for key, text in chosen.items()}
    resolution = "registered" if not upsampled else "generated" if "formulas" in source else "upsampled"
    rows = [
        {"subject": subject["subject"], "pose": pose["pose"], "name": pose["name"]}
        | {f"{kind} landmarks": pose[kind] for kind in ("static", "dynamic")}
        | _measures(pose)
        for subject in subjects
        for pose in subject["poses"]
    ]
    template = data.joinpath("card.md").read_text(encoding="utf-8")
    return template.format_map(
        texts
        | {
            "source": source,
            "build": build,
            "first": subjects[0],
            "n_subjects": counted(len(subjects), "subject", "subjects"),
            "n_poses": counted(len(rows), "target pose", "target poses"),
            "subjects": subject_names(document),
            "files": _read_from(len(source.get("files", {}))),
            "resolution": phrases["resolution"][resolution].format_map(build),
            "tools": ", ".join(f"{name} {version}" for name, version in document["tools"].items()),
            "facts": _facts(subjects),
            "poses": _table(rows),
            "limits": "\n".join(f"- {limit}" for limit in _limits(document)),
        }
    )


def _measures(pose: dict[str, Any]) -> dict[str, str]:
    """Measures of the handles of a pose."""
    moved, turned = pose["static_moved"], [group["turned"] for group in pose["groups"]]
    return {
        "moving handles": pose["moving"],
        "static moved (%)": "-" if moved is None else f"{100 * moved:.2f}",
        "turned (deg)": "-" if None in turned else f"{max(turned):.1f}",
        "residual (%)": f"{100 * max(group['residual'] for group in pose['groups']):.1f}",
    }


def contradiction_texts(subject: dict[str, Any]) -> list[str]:
    """Return a sentence for each static landmark that contradicts a dynamic landmark nearby."""
    return [
        f"subject {subject['subject']}, pose {pose['pose']}: {pair['static']} stays, and the motion of "
        f"{pair['dynamic']}, which is {100 * pair['apart']:.1f} % of the diagonal away, would move it by "
        f"{100 * pair['distance']:.1f} %"
        for pose in subject["poses"]
        for pair in pose["contradictions"]
    ]


def _read_from(count: int) -> str:
    """Number of the source's files; empty for a source without files."""
    files = "one file" if count == 1 else f"{count} files"
    return f" Read from {files}; `dataset.json` lists their sha256." if count else ""


def subject_names(document: dict[str, Any]) -> str:
    """Numbers of the subjects, with the names of their classes if the source has classes."""
    names = document["source"].get("classes")
    numbers = [subject["subject"] for subject in document["subjects"]]
    return ", ".join(str(s) if names is None else f"{s} {names[s]}" for s in numbers)


def _limits(document: dict[str, Any]) -> list[str]:
    """Limits of the source, data that is left out and the reason, and meshes that some methods refuse."""
    source = document["source"]
    found = list(source["limits"])
    if "classes" not in source:
        found.append(
            "The choice of poses and landmarks is this project's; the paper shows them in figures only."
        )
    if source.get("without"):
        found.append(f"Left out: {', '.join(source['without'])}, as configured.")
    found += [f"Left out: {name}: {reason}." for name, reason in source.get("left_out", {}).items()]
    found += [f"Left out: {entry['reason']}." for entry in document.get("left_out", ())]
    for subject in document["subjects"]:
        number, poses = f"subject {subject['subject']}", subject.get("left_out", ())
        found += [f"Left out: {number}, pose {pose['pose']}: {pose['reason']}." for pose in poses]
        found += [f"Landmarks disagree: {text}." for text in contradiction_texts(subject)]
        if subject.get("dropped"):
            counts = ", ".join(f"{n} {kind.replace('_', ' ')}" for kind, n in subject["dropped"].items())
            found.append(f"Removed from {number}, because they are not part of the surface: {counts}.")
        if not subject["low"].get("oriented_manifold", True):
            found.append(f"The meshes of {number} are not oriented manifolds; some methods refuse them.")
        if subject["low"].get("components", 1) > 1:
            found.append(f"The meshes of {number} have {subject['low']['components']} components.")
    return found


def _facts(subjects: Sequence[dict[str, Any]]) -> str:
    return _table(
        {
            "subject": subject["subject"],
            "vertices": f"{high['vertices']:,}",
            "faces": f"{high['faces']:,}",
            "LS3 steps": high["ls3_steps"],
            "volume": "-" if high["volume"] is None else f"{high['volume']:.4g}",
            "area": f"{high['area']:.4g}",
            "self-intersecting": high["self_intersecting_faces"],
            "low vertices": f"{subject['low']['vertices']:,}",
        }
        for subject in subjects
        for high in (subject["high"],)
    )


def _table(rows: Iterable[dict[str, Any]]) -> str:
    """Markdown of a table; the keys of its rows are the head."""
    rows = list(rows)
    head = list(rows[0]) if rows else []
    lines = [head, ["---"] * len(head), *(row.values() for row in rows)]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)

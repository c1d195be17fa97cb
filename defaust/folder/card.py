"""The dataset card, README.md of a DeFAUST folder: data/card.md with the facts of dataset.json filled in."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from typing import Any

#: How rest.ply was made, where it is not the registered mesh.
UPSAMPLED = (
    "High resolution: LS3 Loop subdivision, then isotropic remeshing ({remesh_iterations} rounds) towards "
    "{target_vertices:,} vertices, accepted between {window[0]:g} and {window[1]:g} times that. The remesher "
    "is pymeshlab's, which splits, collapses, flips, smooths and reprojects in the manner of Botsch and "
    "Kobbelt; it stands for the remeshing after Hoppe et al. that the paper cites."
)
KEPT = "High resolution: the registered mesh itself; `rest.ply` and `rest_low.ply` are the same."


def render_card(document: dict[str, Any]) -> str:
    """Markdown of the card; a pure function of dataset.json without the card's own entry."""
    source, build, subjects = (document[key] for key in ("source", "build", "subjects"))
    upsampled = build["target_vertices"] is not None
    poses = [pose for of_subject in document["poses"].values() for pose in of_subject]
    everywhere = [name for name in document["landmarks"] if all(name in pose["landmarks"] for pose in poses)]
    others = [name for name in document["landmarks"] if name not in everywhere]
    count = len(source.get("files", {}))
    own_choice = "The choice of poses and landmarks is this project's; the paper shows them in figures only."
    limits = [*source["limits"], *([] if "classes" in source else [own_choice])]
    template = resources.files("defaust").joinpath("data/card.md").read_text(encoding="utf-8")
    return template.format(
        source=source,
        build=build,
        first=subjects[0],
        n_subjects=len(subjects),
        n_poses=sum(len(subject["poses"]) for subject in subjects),
        at_low=" at low resolution" if upsampled else "",
        subjects=subject_names(document),
        files=f" Read from {count} files, whose sha256 `dataset.json` lists." if count else "",
        where="At low resolution" if upsampled else "As the registered meshes are used,",
        landmarks=", ".join(everywhere),
        more_landmarks=f" Poses that are turned as a whole add {', '.join(others)}." if others else "",
        resolution=UPSAMPLED.format(**build) if upsampled else KEPT,
        tools=", ".join(f"{name} {version}" for name, version in document["tools"].items()),
        facts=_table(
            "subject, vertices, faces, LS3 steps, volume, area, self-intersecting, low vertices",
            [_facts(subject) for subject in subjects],
        ),
        poses=_table(
            "subject, pose, name, static landmarks, dynamic landmarks",
            [
                [subject["subject"], *(pose[key] for key in ("pose", "name", "static", "dynamic"))]
                for subject in subjects
                for pose in subject["poses"]
            ],
        ),
        limits="\n".join(f"- {limit}" for limit in limits),
    )


def subject_names(document: dict[str, Any]) -> str:
    """Numbers of the subjects, with the names of their classes where the source has any."""
    names = document["source"].get("classes")
    return ", ".join(str(s) if names is None else f"{s} {names[s]}" for s in document["build"]["subjects"])


def _facts(subject: dict[str, Any]) -> list[Any]:
    high = subject["high"]
    return [
        subject["subject"],
        f"{high['vertices']:,}",
        f"{high['faces']:,}",
        high["ls3_steps"],
        "-" if high["volume"] is None else f"{high['volume']:.4g}",
        f"{high['area']:.4g}",
        high["self_intersecting_faces"],
        f"{subject['low']['vertices']:,}",
    ]


def _table(head: str, rows: Sequence[Sequence[Any]]) -> str:
    columns = head.split(", ")
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)

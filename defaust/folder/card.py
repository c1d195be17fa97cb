"""The dataset card, README.md of a DeFAUST folder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def render_card(document: dict[str, Any]) -> str:
    """Markdown of the card; a pure function of dataset.json without the card's own entry."""
    sections = (_head, _uses, _structure, _creation, _facts, _limits, _licence)
    return "\n\n".join(section(document) for section in sections) + "\n"


def _head(d: dict[str, Any]) -> str:
    source = d["source"]
    poses = sum(len(s["poses"]) for s in d["subjects"])
    at = " at low resolution" if d["build"]["target_vertices"] else ""
    count = len(source.get("files", {}))
    files = f" Read from {count} files, whose sha256 `dataset.json` lists." if count else ""
    return f"""# DeFAUST: {source["title"]}

A benchmark for the deformation of large meshes by handles: {len(d["subjects"])} subjects at rest, {poses} \
target poses given as handles near landmarks, and the registered target poses as ground truth{at}.

## Sources

{source["origin"]}. Unit: {source["unit"]}. Axes: {source["axes"]}. Subjects: \
{subject_names(d)}. Seed: {d["build"]["seed"]}.{files}"""


def subject_names(d: dict[str, Any]) -> str:
    """Numbers of the subjects, with the names of their classes where the source has any."""
    names = d["source"].get("classes")
    return _list([s if names is None else f"{s} {names[s]}" for s in d["build"]["subjects"]])


def _uses(d: dict[str, Any]) -> str:
    where = "At low resolution" if d["build"]["target_vertices"] else "As the registered meshes are used,"
    return f"""## Uses

Comparing deformation methods on the same handles: loss of volume and area, stretch of edges, change of \
angles, time. {where} the result can also be compared with the true pose.

## Out of scope

Statistics of human bodies, identification of persons, training of models of real anatomy."""


def _structure(d: dict[str, Any]) -> str:
    low = d["subjects"][0]["low"]
    return f"""## Structure

| file | content |
|---|---|
| `dataset.json` | every parameter, tool versions, landmarks, measured facts, files with sha256 |
| `subject_XX/rest.ply` | rest pose at high resolution |
| `subject_XX/rest_low.ply` | registered rest pose, {low["vertices"]:,} vertices and {low["faces"]:,} \
faces for subject {d["subjects"][0]["subject"]} |
| `subject_XX/pose_K.json` | handles: for each landmark its kind (static, dynamic or unused), \
displacement, and positions at rest (`source`) and in the pose (`target`) |
| `subject_XX/pose_K_low.ply` | registered target pose, in correspondence with `rest_low.ply` |

PLY files are binary with float64 positions. Handles are positions on the registered mesh, not vertices of \
`rest.ply`: whoever uses them there snaps them to the nearest vertex and moves the target by the same \
offset."""


def _creation(d: dict[str, Any]) -> str:
    b, tools = d["build"], d["tools"]
    poses = [pose for of_subject in d["poses"].values() for pose in of_subject]
    everywhere = [name for name in d["landmarks"] if all(name in pose["landmarks"] for pose in poses)]
    others = [n for n in d["landmarks"] if n not in everywhere]
    more = f" Poses that are turned as a whole add {_list(others)}." if others else ""
    versions = ", ".join(f"{name} {version}" for name, version in tools.items())
    return f"""## Creation

Selection: {b["handles_per_landmark"]} random vertices among the {b["neighbourhood"]} nearest along the \
edges of each landmark on the registered rest mesh; no vertex serves two landmarks, and all poses of a \
subject use the same vertices. Landmarks of every pose: {_list(everywhere)}.{more} `delta` is the sum of \
the handles' displacements, `delta_mean` their mean; a landmark is static where the mean is below \
{b["static_below"]:g} x the diagonal of the rest mesh's bounding box, else dynamic.

{_resolution(b)} Tools: {versions}."""


def _resolution(build: dict[str, Any]) -> str:
    if build["target_vertices"] is None:
        return "High resolution: the registered mesh itself; `rest.ply` and `rest_low.ply` are the same."
    return f"""High resolution: LS3 Loop subdivision, then isotropic remeshing \
({build["remesh_iterations"]} rounds) towards {build["target_vertices"]:,} vertices, accepted between \
{build["window"][0]:g} and {build["window"][1]:g} times that. The remesher is pymeshlab's, which splits, \
collapses, flips, smooths and reprojects in the manner of Botsch and Kobbelt; it stands for the remeshing \
after Hoppe et al. that the paper cites."""


def _facts(d: dict[str, Any]) -> str:
    rows = [
        (
            s["subject"],
            f"{s['high']['vertices']:,}",
            f"{s['high']['faces']:,}",
            s["high"]["ls3_steps"],
            "-" if s["high"]["volume"] is None else f"{s['high']['volume']:.4g}",
            f"{s['high']['area']:.4g}",
            s["high"]["self_intersecting_faces"],
            f"{s['low']['vertices']:,}",
        )
        for s in d["subjects"]
    ]
    head = (
        "subject",
        "vertices",
        "faces",
        "LS3 steps",
        "volume",
        "area",
        "self-intersecting",
        "low \
vertices",
    )
    poses = [
        (s["subject"], p["pose"], p["name"], p["static"], p["dynamic"])
        for s in d["subjects"]
        for p in s["poses"]
    ]
    return f"""## Measured facts

{_table(head, rows)}

{_table(("subject", "pose", "name", "static landmarks", "dynamic landmarks"), poses)}"""


def _limits(d: dict[str, Any]) -> str:
    limits = list(d["source"]["limits"])
    if "classes" not in d["source"]:
        limits.append(
            "The choice of poses and landmarks is this project's; the paper shows them in figures only."
        )
    lines = "\n".join(f"- {line}" for line in limits)
    return f"""## Limits

{lines}"""


def _licence(d: dict[str, Any]) -> str:
    return f"""## Licence

{d["source"]["licence"]}.

## How to cite

F. Maggioli, D. Baieri, Z. Lähner, S. Melzi, "SShaDe: scalable shape deformation via local representations" \
(the benchmark). {d["source"]["citation"]} (the shapes). Name this build by its `checksum` in \
`dataset.json`."""


def _table(head: Sequence[Any], rows: Sequence[Sequence[Any]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(str(cell) for cell in line)} |" for line in lines)


def _list(items: Sequence[Any]) -> str:
    return ", ".join(str(item) for item in items)

"""Build the files of one subject."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from defaust.build.handles import DYNAMIC, STATIC, choose_handles, handle_records
from defaust.build.measures import case_facts
from defaust.build.options import BuildOptions
from defaust.build.upsample import Upsampled, self_intersecting, upsample
from defaust.folder import layout
from defaust.sources.source import Source
from sshade import InputError, Mesh
from sshade.files.meshes import write_mesh


class UnusableError(InputError):
    """The source's data of a subject cannot be used."""


def build_subject(
    source: Source,
    out: Path,
    *,
    subject: int,
    options: BuildOptions,
    strict: bool = True,
) -> dict[str, Any]:
    """Write a subject's folder. It gets its name when it is complete.

    Returns
    -------
    dict
        The subject's entry in dataset.json: number, landmark vertices, poses, measured facts, and files with
        sha256, size and counts. ``left_out`` lists unusable poses and the reasons.

    Raises
    ------
    UnusableError
        When the rest mesh or all poses cannot be used, the subject cannot be upsampled, or it has too few
        vertices for its handles. With `strict`, a single unusable pose suffices.
    InputError
        When files cannot be written.
    """
    try:
        meshes, texts, record = _content(source, subject=subject, options=options, strict=strict)
    except InputError as error:
        raise UnusableError(f"subject {subject}: {error}") from error
    name = layout.subject_folder(subject)
    final, folder = out / name, out / f".{name}.{os.getpid()}.partial"
    layout.make_folder(folder)
    try:
        for file, mesh in meshes.items():
            write_mesh(folder / file, mesh.V, mesh.F)
        for file, text in texts.items():
            layout.write_text(folder / file, text)
    except InputError as error:
        shutil.rmtree(folder)
        raise InputError(f"subject {subject}: {error}") from error
    files = {f"{name}/{path.name}": _entry(path, meshes) for path in sorted(folder.iterdir())}
    shutil.rmtree(final, ignore_errors=True)
    folder.rename(final)
    return record | {"files": files}


def _content(
    source: Source, *, subject: int, options: BuildOptions, strict: bool
) -> tuple[dict[str, Mesh], dict[str, str], dict[str, Any]]:
    """Meshes and texts of a subject by file name, and its entry in dataset.json without the list of files."""
    rest = source.rest(subject)
    landmarks = source.landmark_vertices(subject)
    chosen = choose_handles(rest, landmarks, subject=subject, options=options)
    regions = [name for name in source.landmark_names if name not in chosen]
    meshes, texts = {layout.REST_LOW: rest}, {}
    facts, left_out = [], []
    for k, pose in enumerate(source.poses(subject), start=1):
        try:
            posed = source.posed(subject, pose)
            if posed is not None and not np.array_equal(posed.F, rest.F):
                raise InputError(f"pose {pose.name} has other faces than the rest pose")
            handles = handle_records(rest, posed, pose, regions=regions, chosen=chosen, options=options)
            kinds = [handle["kind"] for handle in handles]
            if DYNAMIC not in kinds:
                below = 100 * options.static_below
                raise InputError(
                    f"nothing moves in pose {pose.name}: each landmark moves less than {below:g} % of the "
                    "diagonal, so every method would return the rest shape"
                )
        except InputError as error:
            if strict:
                raise
            left_out.append({"pose": k, "name": pose.name, "reason": str(error)})
            continue
        measured: dict[str, Any] = {"volume": None, "registered": False}
        if posed is not None:
            meshes[layout.pose_mesh(k)] = posed
            measured = {"volume": _volume(posed)}
        texts[layout.pose_file(k)] = layout.dump({"source_pose": pose.name, "handles": handles}, indent=None)
        counts = {kind: kinds.count(kind) for kind in (STATIC, DYNAMIC)}
        facts.append({"pose": k, "name": pose.name} | counts | measured | case_facts(rest, posed, handles))
    if not facts:
        raise InputError(left_out[0]["reason"])
    high = _high_resolution(source, rest, subject=subject, options=options)
    meshes[layout.REST] = high.mesh
    dropped = source.dropped(subject)
    record = {
        "subject": subject,
        "landmark_vertices": {name: int(vertex) for name, vertex in landmarks.items()},
        **({"left_out": left_out} if left_out else {}),
        **({"dropped": dict(dropped)} if dropped else {}),
        "poses": facts,
        "low": _mesh_facts(rest),
        "high": _mesh_facts(high.mesh)
        | {"ls3_steps": high.ls3_steps, "edge_length": high.edge_length, "remeshings": high.attempts},
    }
    return meshes, texts, record


def _high_resolution(source: Source, rest: Mesh, *, subject: int, options: BuildOptions) -> Upsampled:
    """Generate the rest mesh at the target resolution, or upsample the registered mesh."""
    target, (least, most) = options.target_vertices, options.window
    mesh = None if target is None else source.generated(subject, vertices=target)
    if target is None or mesh is None:
        return upsample(rest, options)
    if not least * target <= mesh.n <= most * target:
        raise InputError(
            f"the mesh generated for {target} vertices has {mesh.n}, not {least:g} to {most:g} times that; "
            "choose more target_vertices or a wider window"
        )
    return Upsampled(mesh)


def _volume(mesh: Mesh) -> float | None:
    """Enclosed volume; None if the mesh is open or inconsistently oriented."""
    return mesh.volume if mesh.is_closed and mesh.is_oriented else None


def _mesh_facts(mesh: Mesh) -> dict[str, Any]:
    loops, components = mesh.topology.boundary_loops, mesh.topology.components
    return {
        "vertices": mesh.n,
        "faces": mesh.m,
        "euler": mesh.topology.euler,
        **({"boundary_loops": loops} if loops else {}),
        **({"components": components} if components > 1 else {}),
        **({} if mesh.is_manifold and mesh.is_oriented else {"oriented_manifold": False}),
        "volume": _volume(mesh),
        "area": mesh.area,
        "diagonal": float(f"{mesh.diagonal:.12g}"),  # its last bit depends on the processor
        "self_intersecting_faces": int(self_intersecting(mesh).sum()),
    }


def _entry(path: Path, meshes: dict[str, Mesh]) -> dict[str, Any]:
    entry: dict[str, Any] = {"sha256": layout.sha256(path), "bytes": path.stat().st_size}
    mesh = meshes.get(path.name)
    return entry if mesh is None else entry | {"vertices": mesh.n, "faces": mesh.m}

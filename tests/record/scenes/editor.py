"""Sessions of the editor, as the page asks for them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from sshade.edit.commands import Commands
from sshade.edit.selection import near, selected
from sshade.files.task_files import write_handles
from tests.record.scenes.scene import Values, outcomes, scene
from tests.shapes import beside, bumpy, moved_parts, rotation, shifted
from tests.sshade.edit.lent import unpacked
from tests.sshade.edit.sessions import added, begun, edited, ends, switched
from tests.sshade.mesh.test_cutting import t_fin

MOVE = {"pivot": [0, 0, 0.3], "move": [0.1, 0, 0.05], "quaternion": [0.1, 0, 0, 1]}
#: What the page is told in addition to positions, labels and the selection.
TOLD = ("groups", "picked", "parts", "carried", "method", "joints", "converged", "unsaved", "undo", "redo")


def asked(commands: Commands) -> Callable[..., tuple[str, Any]]:
    """Return what executes a command, and names its answer."""

    def said(command: str, /, **given: Any) -> tuple[str, Any]:
        return command, unpacked(commands(command, given))

    return said


def brief(said: tuple[str, Any]) -> tuple[str, Any]:
    """Keep the arrays of an answer and a few facts."""
    name, facts = said
    return name, {key: x for key, x in facts.items() if key in TOLD or isinstance(x, np.ndarray)}


def saved(name: str) -> dict[str, Any]:
    """Return what a handle file has."""
    tree = json.loads(Path(name).read_text())
    for group in tree["handles"]:
        group |= {key: np.array(x) for key, x in group.items() if isinstance(x, list)}
    return tree


@scene
def editor() -> Values:
    with mock.patch("sshade.edit.session.Thread"):  # which binds while the user looks for a place to drag
        yield from edits()


def edits() -> Values:
    session = begun(bumpy(3))
    commands = Commands(session)
    said = asked(commands)
    low, high = ends(session.mesh.V)
    yield "whole", unpacked(commands.whole())
    yield "select", unpacked(commands.select(low, "replace"))
    yield said("mark", kind="fixed")
    yield "select", unpacked(commands.select(high, "replace"))
    yield said("mark", kind="moved")
    move = {"group": 2, **MOVE}
    yield said("drag", **move)
    yield said("drag", **move)
    yield said("release", **move)
    yield said("settle")
    yield said("alter", group=2, name="tip")
    yield said("alter", group=2, weight=3.0)
    yield said("settle")
    yield said("limit", group=2, distance=1.0)
    yield said("pick", group=1)
    yield said("undo")
    yield said("redo")
    yield said("set_up", method="paper", joints=0.5)
    yield said("restore", group=2)
    yield said("release", **move)
    yield said("save", what="handles", name="groups.json", over=True)
    yield said("save", what="mesh", name="shape.ply", over=True)
    yield said("remove", group=3)
    yield "command", session.document.command
    yield "saved", saved("groups.json")
    session.end(5)


@outcomes
def editor_of_files() -> Values:
    """Handles of a file, other options, groups on a moved shape, and work that is recovered."""
    with mock.patch("sshade.edit.session.Thread"), mock.patch("sshade.edit.recovery._is_running") as runs:
        runs.return_value = False
        V, (low, high) = bumpy(3).V, ends(bumpy(3).V)
        turns = [None, rotation(4), None]
        parts = (low, 0), (high, [0.2, 0, 0]), ([300], [0.1, 0, 0])
        handles = moved_parts(V, *parts, rotations=turns, weights=[np.inf, 5.0, np.inf])
        write_handles("pose.json", handles, names={0: "low", 1: "high"})
        session = begun(bumpy(3), begin="pose.json")
        said = asked(Commands(session))
        yield "groups", [vars(group) for group in session.state.groups]
        session.save("handles", "again.json", over=True)
        yield "again", saved("again.json")
        for command, given in (
            ("settle", {}),
            ("set_up", {"method": "fast", "joints": 0}),
            ("settle", {}),
            ("undo", {}),
            ("settle", {}),
            ("redo", {}),
            ("set_up", {"method": "fine"}),
            ("settle", {}),
            ("release", {"group": 3, **MOVE}),
            ("release", {"group": 3, **MOVE}),
            ("drag", {"group": 2, **MOVE}),
            ("drag", {"group": 2, **MOVE}),
            ("settle", {}),
        ):
            yield brief(said(command, **given))
        for command, given in (  # what a bound mesh knows, changed between drags
            ("alter", {"group": 2, "weight": 0.5}),
            ("alter", {"group": 3, "kind": "fixed"}),
            ("set_up", {"method": "fast", "joints": 0}),
            ("set_up", {"method": "fast", "joints": 1.5}),
            ("remove", {"group": 3}),
            ("undo", {}),
        ):
            said(command, **given)
            yield f"drag after {command} {given}", said("drag", group=2, **MOVE)[1]["positions"]
        session.select(np.arange(0, V.shape[0], 7), "replace")
        yield brief(said("mark", kind="fixed"))
        yield brief(said("alter", group=4, kind="moved", weight=2.0))
        yield brief(said("restore", group=4))
        yield "aims", session.state.aims()
        again = edited()
        yield "offers", [offer.groups for offer in again.recovery.offers]
        said = asked(Commands(again))
        for command in ("recover", "settle", "undo", "redo"):
            yield brief(said(command))
        again.select(np.array([5, 6]), "replace")
        yield "numbers", [group["number"] for group in said("mark", kind="fixed")[1]["groups"]]
        again.save("handles", "recovered.json", over=True)
        session.recovery.remove()
        again.recovery.remove()
        yield "recovered", saved("recovered.json")


@outcomes
def editor_of_parts() -> Values:
    """Drags of several components, of a surface that is cut, and of every kind of group."""
    with mock.patch("sshade.edit.session.Thread"):
        body = bumpy(2)
        for name, mesh in {"parts": beside(body, shifted(body, [4, 0, 0])), "cut": t_fin(4)}.items():
            session = begun(mesh)
            axis = 2 if name == "parts" else 0
            x = np.where(mesh.V[:, 0] < 2, mesh.V[:, axis], 0) if name == "parts" else mesh.V[:, 0]
            for kind, own in (("fixed", x < x.min() + 0.9), ("moved", x > x.max() - 0.9)):
                added(session, np.flatnonzero(own), kind)
            said = asked(Commands(session))
            for command in ("drag", "drag", "release", "drag", "settle"):
                yield f"{name} {command}", brief(said(command, group=2, **MOVE))[1]
        with mock.patch("sshade.edit.dragging.REBOUND", 0):  # as on a large mesh
            session = begun(bumpy(3), method="fine")
            said = asked(Commands(session))
            low, high = ends(session.mesh.V, 0.08)  # so small that the samples of the first groups serve
            band = np.flatnonzero(np.abs(session.mesh.V[:, 2]) < 0.1)
            for kind, own in (("fixed", low), ("moved", high), ("fixed", band)):
                added(session, own, kind)
                yield ("kept", session.state.made) if own is low else brief(said("drag", group=2, **MOVE))
            for command, given in (
                ("alter", {"group": 1, "weight": 2.0}),
                ("remove", {"group": 3}),
                ("limit", {"group": 2, "distance": 0.6}),
                ("set_up", {"method": "paper"}),
            ):
                said(command, **given)
                yield command, said("drag", group=2, **MOVE)
        with mock.patch("sshade.edit.preview.VERTICES", 100):  # what the page of a large mesh gets
            session = switched(single=False)
            said = asked(Commands(session))
            for command in ("drag", "release", "settle"):
                yield f"large {command}", brief(said(command, group=2, **MOVE))
        session = switched(single=True)
        said = asked(Commands(session))
        for command, number in (("drag", 2), ("drag", 3), ("release", 3), ("settle", 3), ("drag", 5)):
            yield brief(said(command, group=number, **MOVE))
        said("restore", group=3)
        yield "turns", [group.turn for group in session.state.groups]
        said("undo")
        session.save("handles", "all.json", over=True)
        yield "command", session.document.command
        yield "all", saved("all.json")


@scene
def memory_of_picking() -> Values:
    mesh = bumpy(5)
    yield "near", near(mesh, np.arange(1000), 0.3)
    yield "linked", selected(mesh, mesh.V[:, 2] > 1, np.empty(0, dtype=np.int64), "linked")

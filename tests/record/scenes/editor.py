"""A session of the editor, as the page asks for it."""

from pathlib import Path
from typing import Any
from unittest import mock

from sshade.edit.commands import Commands
from tests.record.scenes.scene import Values, scene
from tests.shapes import bumpy
from tests.sshade.edit.lent import unpacked
from tests.sshade.edit.sessions import begun, ends


@scene
def editor() -> Values:
    with mock.patch("sshade.edit.session.Thread"):  # which binds while the user looks for a place to drag
        yield from edits()


def edits() -> Values:
    session = begun(bumpy(3))
    commands = Commands(session)
    low, high = ends(session.mesh.V)

    def said(command: str, /, **given: Any) -> tuple[str, Any]:
        return command, unpacked(commands(command, given))

    yield "whole", unpacked(commands.whole())
    yield "select", unpacked(commands.select(low, "replace"))
    yield said("mark", kind="fixed")
    yield "select", unpacked(commands.select(high, "replace"))
    yield said("mark", kind="moved")
    move = {"group": 2, "pivot": [0, 0, 0.3], "move": [0.1, 0, 0.05], "quaternion": [0.1, 0, 0, 1]}
    yield said("drag", **move)
    yield said("release", **move)
    yield said("settle")
    yield said("alter", group=2, weight=3.0, name="tip")
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
    yield "saved", Path("groups.json").read_text()
    session.end(5)

"""Commands that the page sends to a session, and their answers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import inf, isfinite
from typing import Any

import numpy as np

from sshade.core.errors import InputError, reason
from sshade.core.progress import Progress, silent
from sshade.edit.groups import Group, Motion
from sshade.edit.preview import preview
from sshade.edit.session import Session
from sshade.mesh.incidence import flagged

#: Arrays of an answer after a change of groups or of the selection.
CHANGED = ("positions", "labels", "selection")
#: Commands that are methods of the session, without an argument and with the number of a group.
PLAIN = ("undo", "redo", "recover", "discard")
OF_GROUPS = ("remove", "restore")


class Commands:
    """A session in the coordinates of the page: the bounding box has centre 0 and diagonal 1.

    float32 positions then keep seven digits, whatever the place and unit of the mesh. During a drag of a
    large mesh without materials, the page receives only the vertices of
    :func:`sshade.edit.preview.preview`.

    Parameters
    ----------
    session : Session
    progress : Progress
    """

    def __init__(self, session: Session, progress: Progress = silent) -> None:
        self._session, self._progress = session, progress
        V = session.mesh.V
        self._centre, self._scale = 0.5 * (V.min(axis=0) + V.max(axis=0)), session.mesh.diagonal
        self._preview = None if session.document.has_skin else preview(session.mesh)

    def __call__(self, name: str, arguments: Mapping[str, Any]) -> bytes:
        """Execute a command and return the answer.

        Parameters
        ----------
        name : str
        arguments : mapping

        Raises
        ------
        InputError
            When the session refuses the command.
        Superseded
            See :meth:`sshade.edit.workspace.Workspace.settle`.
        """
        if name in PLAIN:
            getattr(self._session, name)()
            return self._answer(*CHANGED)
        if name in OF_GROUPS:
            getattr(self._session, name)(arguments["group"])
            return self._answer(*CHANGED)
        return getattr(self, f"do_{name}")(arguments)

    def whole(self) -> bytes:
        """Return everything that a page needs at the beginning."""
        few = self._preview
        coarse = {} if few is None else {"coarse": few.vertices, "coarse_faces": few.faces.ravel()}
        further = {name: ids.astype(np.uint32) for name, ids in coarse.items()}
        further["rest"] = self._positions(self._session.mesh.V)
        document = self._session.document
        coloured, skin = document.is_coloured, document.has_skin
        return self._answer("faces", *CHANGED, further=further, coloured=coloured, skin=skin)

    def colours(self) -> bytes:
        """Return the colours of the vertices of a file that has some."""
        colours = self._session.document.colours
        assert colours is not None  # the page asks where `coloured` is true
        return packet({}, {"colours": colours.ravel()})

    def skin(self) -> bytes:
        """Return the materials of the file, and copies of vertices with texture coordinates."""
        skin = self._session.document.skin
        materials = [
            {"colour": one.colour.tolist(), "image": one.texture is not None} for one in skin.materials
        ]
        arrays = {"vertex": skin.vertex.astype(np.uint32), "faces": skin.faces.ravel().astype(np.uint32)}
        arrays["uv"] = skin.uv.ravel().astype(np.float32)
        return packet({"materials": materials, "runs": skin.runs}, arrays)

    def image(self, arguments: Mapping[str, Any]) -> bytes:
        """Return the image file of a material."""
        document = self._session.document
        texture = document.skin.materials[int(arguments["material"])].texture
        assert texture is not None  # the page asks for the images of materials that have one
        try:
            return texture()
        except (OSError, ValueError, LookupError) as error:
            why = reason(error) if isinstance(error, OSError) else error
            raise InputError(f"{document.name}: a texture cannot be shown ({why})") from error

    def select(self, vertices: np.ndarray, how: str) -> bytes:
        """Select vertices (k,) int."""
        self._session.select(vertices, how)
        return self._answer("selection")

    def do_mark(self, arguments: Mapping[str, Any]) -> bytes:
        number = self._session.mark(arguments["kind"])
        return self._answer(*CHANGED, marked=number)

    def do_alter(self, arguments: Mapping[str, Any]) -> bytes:
        group = self._session.state.group(arguments["group"])
        weight = arguments.get("weight", group.weight)
        self._session.alter(
            group.number,
            kind=arguments.get("kind", group.kind),
            name=arguments.get("name", group.name),
            weight=inf if weight is None else weight,
        )
        return self._answer(*CHANGED)

    def do_pick(self, arguments: Mapping[str, Any]) -> bytes:
        group = self._session.state.group(arguments["group"])
        return self.select(group.vertices, "replace")

    def do_limit(self, arguments: Mapping[str, Any]) -> bytes:
        self._session.limit(arguments["group"], arguments["distance"])
        return self._answer(*CHANGED)

    def do_set_up(self, arguments: Mapping[str, Any]) -> bytes:
        self._session.set_up(arguments["method"], joints=arguments.get("joints"))
        return self._answer("positions")

    def do_drag(self, arguments: Mapping[str, Any]) -> bytes:
        V = self._session.drag(arguments["group"], self._motion(arguments))
        few = self._preview
        return packet({}, {"positions": self._positions(V if few is None else V[few.vertices])})

    def do_release(self, arguments: Mapping[str, Any]) -> bytes:
        self._session.release(arguments["group"], self._motion(arguments))
        return self._answer() if self._preview is None else self._answer("positions")

    def do_settle(self, _: Mapping[str, Any]) -> bytes:
        self._session.settle(self._progress)
        return self._answer("positions")

    def do_save(self, arguments: Mapping[str, Any]) -> bytes:
        over = arguments.get("over", False)
        path, lost = self._session.save(
            arguments["what"], arguments["name"], over=over, progress=self._progress
        )
        return self._answer("positions", saved=str(path), lost=list(lost))

    def _carried(self, groups: tuple[Group, ...]) -> int:
        """Count the components without vertices of groups, which move with the nearest component."""
        held = [group.vertices for group in groups]
        return len(self._session.mesh.components_without(np.concatenate(held))) if held else 0

    def _motion(self, arguments: Mapping[str, Any]) -> Motion:
        pivot, move, quaternion = (np.array(arguments[name]) for name in ("pivot", "move", "quaternion"))
        return Motion.about(self._centre + self._scale * pivot, quaternion, self._scale * move)

    def _positions(self, V: np.ndarray) -> np.ndarray:
        """Convert positions (n, 3) to the coordinates of the page, float32."""
        return ((V - self._centre) / self._scale).astype(np.float32)

    def _answer(self, *names: str, further: Mapping[str, np.ndarray] | None = None, **facts: Any) -> bytes:
        """Pack the state of the session, further facts, the named arrays and further arrays."""
        session, mesh, arrays = self._session, self._session.mesh, dict(further or {})
        state = session.state
        for name in names:
            if name == "positions":
                arrays[name] = self._positions(session.shown)
            elif name == "faces":
                arrays[name] = mesh.F.astype(np.uint32)
            elif name == "labels":
                arrays[name] = np.zeros(mesh.n, dtype=np.uint32)
                for number, group in enumerate(state.groups, start=1):
                    arrays[name][group.vertices] = number
            else:
                arrays[name] = np.zeros(mesh.n, dtype=np.uint8)
                arrays[name][state.selection] = 1
        facts["groups"] = [
            {
                "number": group.number,
                "name": group.name,
                "kind": group.kind,
                "vertices": len(group.vertices),
                "pivot": ((group.target.mean(axis=0) - self._centre) / self._scale).tolist(),
                "weight": group.weight if isfinite(group.weight) else None,
            }
            for group in state.groups
        ]
        vertices, faces = session.document.size
        facts |= {
            "mesh": {"name": session.document.name, "vertices": vertices, "faces": faces},
            "scale": self._scale,
            "version": session.version,
            "picked": len(state.selection),
            "parts": int(flagged(mesh.component[state.selection], mesh.topology.components).sum()),
            "carried": self._carried(state.groups),
            "method": state.method,
            "joints": state.resolved.joints,
            "quality": state.quality if session.is_converged else "",
            "converged": session.is_converged,
            "unsaved": session.is_unsaved,
            "undo": session.history.can_undo,
            "redo": session.history.can_redo,
            "outputs": {content: path.name for content, path in session.document.outputs.items()},
            "command": session.document.command,
            "trouble": session.trouble,
            "recovery": [
                {"name": path.name, "time": t, "groups": n} for path, t, n in session.recovery.offers
            ],
        }
        return packet(facts, arrays)


def packet(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Pack JSON and arrays so that the page need not parse the arrays.

    The packet consists of the length of the JSON as uint32, the JSON, and the arrays, little-endian and
    aligned to 4 bytes. The JSON lists the name, type and size of each array under ``arrays``.

    Parameters
    ----------
    facts : mapping
    arrays : mapping
        Arrays float32, uint32 or uint8, which JavaScript can view in place.
    """
    listed = [[name, str(array.dtype), array.size] for name, array in arrays.items()]
    head = json.dumps({**facts, "arrays": listed}, allow_nan=False).encode()
    head += b" " * (-len(head) % 4)
    parts = [len(head).to_bytes(4, "little"), head]
    for array in arrays.values():
        content = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        parts += [content, b"\0" * (-len(content) % 4)]
    return b"".join(parts)

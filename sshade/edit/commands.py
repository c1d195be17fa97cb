"""What a page may ask of a session, and what it is answered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, isfinite
from typing import Any, get_args

import numpy as np

from sshade.edit.packet import packet
from sshade.edit.preview import VERTICES, Preview, preview
from sshade.edit.session import Session
from sshade.edit.state import MethodName, Motion, Settings
from sshade.errors import InputError
from sshade.figures import colour_range, edge_error
from sshade.progress import Progress

#: Names of arrays of vertices that a change of groups, or of what is picked, changes.
MARKS = ("labels", "selection")


class Commands:
    """A session in the coordinates of a page: the middle of the mesh is 0, its diagonal 1.

    float32 positions keep seven digits of them, wherever the mesh lies and whatever its unit is. A page that
    says what it is "drawn" by, a "card" or the "processor", is sent in a drag of a large mesh the vertices of
    its :func:`sshade.edit.preview.preview` alone.

    Parameters
    ----------
    session : Session
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        V = session.mesh.V
        self._centre, self._scale = 0.5 * (V.min(axis=0) + V.max(axis=0)), session.mesh.diagonal
        self._previews: dict[str, Preview | None] = {}
        self._named: dict[str, Callable[..., bytes]] = {
            name.removeprefix("do_"): getattr(self, name) for name in dir(self) if name.startswith("do_")
        }

    def __call__(self, name: str, given: Any, progress: Progress) -> bytes:
        """The answer to a command.

        Parameters
        ----------
        name : str
        given : mapping
            What the page says beside.
        progress : Progress

        Raises
        ------
        InputError
            On an unknown command, something missing or of another kind, or where the session refuses.
        Superseded
            See :meth:`sshade.edit.session.Session.settle`.
        """
        if name not in self._named:
            raise InputError(f"{name!r} is no command of the editor")
        if not isinstance(given, Mapping):
            raise InputError("a command takes an object")
        return self._named[name](given, progress)

    def whole(self, given: Mapping[str, Any]) -> bytes:
        """All that a page needs at its beginning."""
        few = self._preview(given)
        coarse = {} if few is None else {"coarse": few.vertices, "coarse_faces": few.faces.ravel()}
        beside = {name: ids.astype(np.uint32) for name, ids in coarse.items()}
        return self._answer("faces", "positions", "change", *MARKS, beside=beside)

    def select(self, vertices: np.ndarray, how: str) -> bytes:
        """Pick vertices (k,) int."""
        self._session.select(vertices, how)
        return self._answer("selection")

    def open(self, content: bytes, name: str) -> bytes:
        """Take the groups of a handle file."""
        self._session.open(content, name)
        return self._answer("positions", *MARKS)

    def do_mark(self, given: Mapping[str, Any], _: Progress) -> bytes:
        number = self._session.mark(_text(given, "kind"))  # type: ignore[arg-type]
        return self._answer("positions", *MARKS, marked=number)

    def do_remove(self, given: Mapping[str, Any], _: Progress) -> bytes:
        self._session.remove(_whole(given, "group"))
        return self._answer("positions", *MARKS)

    def do_restore(self, given: Mapping[str, Any], _: Progress) -> bytes:
        self._session.restore(_whole(given, "group"))
        return self._answer("positions")

    def do_alter(self, given: Mapping[str, Any], _: Progress) -> bytes:
        fields: dict[str, Any] = {name: _text(given, name) for name in ("kind", "name") if name in given}
        if "weight" in given:
            fields["weight"] = inf if given["weight"] is None else _numbers(given, "weight", ())
        self._session.alter(_whole(given, "group"), **fields)
        return self._answer("positions", *MARKS)

    def do_pick(self, given: Mapping[str, Any], _: Progress) -> bytes:
        group = self._session.state.group(_whole(given, "group"))
        return self.select(group.vertices, "replace")

    def do_set_up(self, given: Mapping[str, Any], _: Progress) -> bytes:
        method = _text(given, "method")
        if method not in get_args(MethodName):
            raise InputError(f"{method!r} is no method of the editor")
        volume, area = (bool(given.get(name, True)) for name in ("volume", "area"))
        self._session.set_up(Settings(method, volume, area))  # type: ignore[arg-type]
        return self._answer("positions")

    def do_undo(self, _: Mapping[str, Any], __: Progress) -> bytes:
        self._session.undo()
        return self._answer("positions", *MARKS)

    def do_redo(self, _: Mapping[str, Any], __: Progress) -> bytes:
        self._session.redo()
        return self._answer("positions", *MARKS)

    def do_drag(self, given: Mapping[str, Any], _: Progress) -> bytes:
        V = self._session.drag(_whole(given, "group"), self._motion(given))
        few = self._preview(given)
        if few is not None:
            V = V[few.vertices]
        return packet({}, {"positions": self._positions(V)})

    def do_release(self, given: Mapping[str, Any], _: Progress) -> bytes:
        self._session.release(_whole(given, "group"), self._motion(given))
        return self._answer() if self._preview(given) is None else self._answer("positions")

    def do_settle(self, _: Mapping[str, Any], progress: Progress) -> bytes:
        self._session.settle(progress)
        return self._answer("positions", "change")

    def do_save(self, given: Mapping[str, Any], progress: Progress) -> bytes:
        what, name, over = _text(given, "what"), _text(given, "name"), given.get("over") is True
        lost: tuple[str, ...] = ()
        if what == "mesh":
            path, lost = self._session.save_mesh(name, over=over, progress=progress)
        elif what == "handles":
            path = self._session.save_handles(name, over=over)
        else:
            raise InputError(f"{what!r} cannot be saved: the handles can, and the mesh")
        return self._answer("positions", "change", saved=str(path), lost=list(lost))

    def _preview(self, given: Mapping[str, Any]) -> Preview | None:
        """That of a page which says what it is drawn by; none of another, or of a small mesh."""
        drawn = given.get("drawn")
        if drawn is None:
            return None
        if drawn not in VERTICES:
            raise InputError(f"{drawn!r} draws no page: one of {', '.join(VERTICES)} does")
        if drawn not in self._previews:
            self._previews[drawn] = preview(self._session.mesh, drawn)
        return self._previews[drawn]

    def _motion(self, given: Mapping[str, Any]) -> Motion:
        pivot, move = _numbers(given, "pivot", (3,)), _numbers(given, "move", (3,))
        quaternion = _numbers(given, "quaternion", (4,))
        if not quaternion.any():
            raise InputError("a quaternion of length 0 is no rotation")
        return Motion.about(self._centre + self._scale * pivot, quaternion, self._scale * move)

    def _positions(self, V: np.ndarray) -> np.ndarray:
        """(n, 3) float32 as the page has them."""
        return ((V - self._centre) / self._scale).astype(np.float32)

    def _answer(self, *arrays: str, beside: Mapping[str, np.ndarray] | None = None, **facts: Any) -> bytes:
        """The facts, and those arrays, beside some; edges' changes where the shape is settled."""
        session, made = self._session, dict(beside or {})
        state = session.state
        for name in arrays:
            if name == "positions":
                made[name] = self._positions(session.shown).ravel()
            elif name == "faces":
                made[name] = session.mesh.F.astype(np.uint32).ravel()
            elif name == "labels":
                made[name] = np.zeros(session.mesh.n, dtype=np.uint32)
                for number, group in enumerate(state.groups, start=1):
                    made[name][group.vertices] = number
            elif name == "selection":
                made[name] = np.zeros(session.mesh.n, dtype=np.uint8)
                made[name][state.selection] = 1
            elif session.is_settled:
                change = edge_error(session.mesh, session.shown)
                facts["top"] = colour_range([change])
                made[name] = np.minimum(255 * change / facts["top"], 255).astype(np.uint8)
        return packet({**self._facts(), **facts}, made)

    def _facts(self) -> dict[str, Any]:
        session, mesh = self._session, self._session.mesh
        state, outputs = session.state, session.document.outputs
        carry = session.document.carry_unconstrained
        groups = [
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
        return {
            "mesh": {"name": session.document.name, "vertices": mesh.n, "faces": mesh.m},
            "groups": groups,
            "picked": len(state.selection),
            "settings": state.settings._asdict(),
            "settled": session.is_settled,
            "unsaved": session.is_unsaved,
            "undo": session.history.can_undo,
            "redo": session.history.can_redo,
            "outputs": {what: path.name for what, path in outputs.path.items()},
            "command": outputs.command(state.settings, carry_unconstrained=carry),
        }


def _text(given: Mapping[str, Any], name: str) -> str:
    if not isinstance(given.get(name), str):
        raise InputError(f'the command needs a text "{name}"')
    return given[name]


def _whole(given: Mapping[str, Any], name: str) -> int:
    value = given.get(name)
    if not isinstance(value, int) or isinstance(value, bool):
        raise InputError(f'the command needs a whole number "{name}"')
    return value


def _numbers(given: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Any:
    try:
        values = np.asarray(given.get(name), dtype=np.float64)
    except (TypeError, ValueError):  # words, objects, lists of several lengths
        values = np.full(0, np.nan)
    if values.shape != shape or not np.isfinite(values).all():
        raise InputError(f'the command needs "{name}": {"numbers" if shape else "a number"}')
    return values if shape else float(values)

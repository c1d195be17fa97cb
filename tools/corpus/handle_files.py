"""Cases: handle files of every kind for one sound mesh."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tools.corpus import write
from tools.corpus.case import Case, one
from tools.corpus.shapes import body

V, F = body(2)
ORDER = np.argsort(V[:, 2], kind="stable")
LOW, HIGH = np.sort(ORDER[:20]), np.sort(ORDER[-20:])
TURN = Rotation.from_rotvec([0.2, 0.3, -0.1])
R, Q = TURN.as_matrix().tolist(), TURN.as_quat().tolist()
SHIFT = [0.2, -0.1, 0.15]
FOOT = {"landmark": "foot", "kind": "static", "vertices": LOW.tolist()}
CENTER = V[HIGH].mean(axis=0)
LIFTED = V[HIGH] + SHIFT
TURNED = V[HIGH] @ TURN.as_matrix().T + SHIFT
ABOUT_CENTER = (V[HIGH] - CENTER) @ TURN.as_matrix().T + CENTER + SHIFT
#: A box around the moving vertices alone.
BOX = [(V[HIGH].min(axis=0) - 0.001).tolist(), (V[HIGH].max(axis=0) + 0.001).tolist()]
IN_BOX = np.flatnonzero((BOX[0] <= V).all(axis=1) & (BOX[1] >= V).all(axis=1))
HEAD = {"landmark": "head", "vertices": HIGH.tolist()}
RUNS = {"runs": [[int(i), 1] for i in HIGH]}


def _array(values: Any, dtype: str) -> dict[str, Any]:
    values = np.asarray(values).astype(dtype)
    return {
        "base64": base64.b64encode(values.tobytes()).decode(),
        "dtype": dtype,
        "shape": list(values.shape),
    }


def _file(*entries: Any, **more: Any) -> bytes:
    return json.dumps({**more, "handles": list(entries)}).encode()


def _moved(targets: np.ndarray) -> dict[str, Any]:
    return {**HEAD, "target": targets.tolist()}


#: Handle files that lift the upper end.
LIFTS = {
    "ids": _file(FOOT, _moved(LIFTED)),
    "positions": _file({"source": V[LOW].tolist()}, {"source": V[HIGH].tolist(), "target": LIFTED.tolist()}),
    "ids that only move": _file(FOOT, {**HEAD, "translation": SHIFT}),
    "positions that only move": _file(FOOT, {"source": V[HIGH].tolist(), "translation": SHIFT}),
    "runs": _file(FOOT, {**HEAD, "vertices": RUNS, "translation": SHIFT}),
    "arrays": _file(FOOT, {"vertices": _array(HIGH, "<i4"), "target": _array(LIFTED, "<f8")}),
    "keys of one's own": _file({**FOOT, "_note": "mine"}, _moved(LIFTED), _tool="x"),
    "keys that the project writes": _file(
        {**FOOT, "delta": 0.1}, {**_moved(LIFTED), "delta_mean": [0, 0, 1]}, source_pose="rest", made="today"
    ),
    "unused groups": _file(FOOT, {"kind": "unused", "vertices": [1]}, _moved(LIFTED)),
    "a byte-order mark": b"\xef\xbb\xbf" + _file(FOOT, _moved(LIFTED)),
    "UTF-16": _file(FOOT, _moved(LIFTED)).decode().encode("utf-16"),
    "UTF-16 big endian": b"\xfe\xff" + _file(FOOT, _moved(LIFTED)).decode().encode("utf-16-be"),
    "CRLF and other scripts": json.dumps(
        {"handles": [{**FOOT, "landmark": "стопа 足"}, _moved(LIFTED)]}, ensure_ascii=False, indent=1
    )
    .replace("\n", "\r\n")
    .encode(),
    "the same vertex twice": _file(FOOT, _moved(LIFTED), _moved(LIFTED)),
}
#: The handle file, the vertices whose targets are known, and the targets.
TAKEN: dict[str, tuple[bytes, np.ndarray, np.ndarray]] = {
    "boxes that turn": (
        _file(FOOT, {"boxes": [BOX], "rotation": R, "translation": SHIFT}),
        IN_BOX,
        V[IN_BOX] @ TURN.as_matrix().T + SHIFT,
    ),
    "boxes that only move": (_file(FOOT, {"boxes": [BOX], "translation": SHIFT}), IN_BOX, V[IN_BOX] + SHIFT),
    "boxes that only turn": (
        _file(FOOT, {"boxes": [BOX], "rotation": Q}),
        IN_BOX,
        V[IN_BOX] @ TURN.as_matrix().T,
    ),
    "boxes that stay": (
        _file({"boxes": [BOX]}, {"vertices": LOW.tolist(), "translation": SHIFT}),
        IN_BOX,
        V[IN_BOX],
    ),
    "ids that turn": (_file(FOOT, {**HEAD, "rotation": R, "translation": SHIFT}), HIGH, TURNED),
    "ids that turn about a point": (
        _file(FOOT, {**HEAD, "rotation": R, "translation": SHIFT, "center": CENTER.tolist()}),
        HIGH,
        ABOUT_CENTER,
    ),
    "ids that turn about their centroid": (
        _file(FOOT, {**HEAD, "rotation": Q, "translation": SHIFT, "center": "centroid"}),
        HIGH,
        ABOUT_CENTER,
    ),
    "prescribed rotation": (_file(FOOT, {**_moved(ABOUT_CENTER), "rotation": Q}), HIGH, ABOUT_CENTER),
    "static groups alone": (_file(FOOT, {**HEAD, "kind": "static"}), HIGH, V[HIGH]),
    "one vertex": (_file({"vertices": [int(HIGH[0])], "target": [LIFTED[0].tolist()]}), HIGH[:1], LIFTED[:1]),
    "all vertices": (
        _file({"vertices": list(range(len(V))), "target": (V + SHIFT).tolist()}),
        np.arange(len(V)),
        V + SHIFT,
    ),
}
#: Soft handles: the file, and how far from the targets the vertices may be, as a fraction of the diagonal.
SOFT = {
    "soft": (_file(FOOT, {**_moved(LIFTED), "weight": 1}), 0.05),
    "stiff": (_file(FOOT, {**_moved(LIFTED), "weight": 1000}), 0.005),
}
P = V.tolist()
#: The entries or the contents of a handle file, and words of the refusal.
REFUSED: dict[str, tuple[Any, ...]] = {
    "an empty file": (b"", "not readable as JSON"),
    "random bytes": (np.random.default_rng(2).bytes(300), "not readable as JSON"),
    "cut": (_file(FOOT)[:-9], "not readable as JSON"),
    "brackets 100,000 deep": (b"[" * 100_000, "not readable as JSON"),
    "a list": (b"[1, 2]", '"handles"'),
    "numbers for entries": (_file(1, 2), "entry 0"),
    "no entries": (_file(), "there are no handles"),
    "unused entries alone": (_file({"kind": "unused"}), "there are no handles"),
    "an unknown kind": ({"kind": "moving", "vertices": [1]}, "unknown kind"),
    "neither ids nor positions": ({"kind": "static"}, '"vertices"'),
    "ids and positions": ({"vertices": [1], "source": [P[1]]}, '"vertices"'),
    "dynamic without a motion": ({"kind": "dynamic", "vertices": [1]}, "it is dynamic and has no"),
    "fewer targets than ids": ({"vertices": [1, 2], "target": [P[1]]}, "2 handles have 1 targets"),
    "an id beyond the mesh": ({"vertices": [162]}, "0..161, not 162"),
    "a negative id": ({"vertices": [-1]}, "0..161, not -1"),
    "ids of 1.5": ({"vertices": [1.5]}, '"vertices"'),
    "ids that are true": ({"vertices": [True]}, '"vertices"'),
    "ids that are text": ({"vertices": ["1"]}, "a text in place of a number"),
    "ids in lists of several lengths": ({"vertices": [[1], [1, 2]]}, '"vertices"'),
    "a run that is no pair": ({"vertices": {"runs": [[1, 2, 3]]}}, "list of pairs [first id, count]"),
    "half of an array": (
        {"vertices": {"base64": "AAAA", "dtype": "<i4", "shape": [1]}},
        'do not fit its "shape"',
    ),
    "a number of 400 digits": ({"source": [[0, 1, 10**400]]}, "too large"),
    "a key twice": (
        b'{"handles": [{"vertices": [1], "vertices": [2]}]}',
        'the key "vertices" occurs twice in one object',
    ),
    "a key of another program": ({**HEAD, "comment": "left foot"}, "begin with _"),
    "a static vertex that is also moved": (
        _file({"vertices": [50]}, {"vertices": [50], "target": [P[51]]}),
        "contradictory",
    ),
    "ids of 30 digits": ({"vertices": [10**30]}, '"vertices"'),
    "no ids": ({"vertices": []}, '"vertices"'),
    "positions of two numbers": ({"source": [[0, 1]]}, '"source"'),
    "a position of null": ({"source": [[0, 1, None]]}, '"source"', "NaN"),
    "a target of NaN": ({"vertices": [1], "target": [[0, float("nan"), 0]]}, "NaN"),
    "a target of infinity": ({"vertices": [1], "target": [[0, float("inf"), 0]]}, "infinite"),
    "a weight of 0": ({"vertices": [1], "weight": 0}, '"weight"'),
    "a weight of NaN": ({"vertices": [1], "weight": float("nan")}, '"weight"'),
    "a rotation that shears": (
        {**HEAD, "rotation": [[1, 1, 0], [0, 1, 0], [0, 0, 1]], "translation": SHIFT},
        '"rotation" is no rotation',
    ),
    "a long quaternion": ({**HEAD, "rotation": [1, 1, 0, 0], "translation": SHIFT}, "quaternion"),
    "a misspelt key": ({**HEAD, "trnslation": SHIFT}, '"translation"'),
    "a misspelt weight": ({**_moved(LIFTED), "wieght": 3}, '"weight"'),
    "an unknown key": ({**HEAD, "colour": "red"}, 'no key "colour"'),
    "an unknown key of the file": (_file(FOOT, handels=[]), '"handels"'),
    "swapped corners of a box": ({"boxes": [BOX[::-1]], "translation": SHIFT}, "corners"),
    "an empty box": ({"boxes": [[[90, 90, 90], [91, 91, 91]]]}, "entry 0"),
    "a position far away": ({"source": [[50, 0, 0]]}, "diagonal"),
    "contradictory groups": (
        _file(*({"vertices": [50], "target": [P[k]]} for k in (51, 52))),
        "contradictory targets",
    ),
    "contradictory targets in a group": ({"vertices": [50, 50], "target": [P[50], P[51]]}, "contradictory"),
    "contradictory positions in a group": (
        {"source": [P[50], P[50]], "target": [P[50], P[51]]},
        "have the same nearest vertex, 50, and contradictory targets",
    ),
    "a center without a rotation": ({**HEAD, "translation": SHIFT, "center": "centroid"}, '"center"'),
    "a target and a translation": ({**_moved(LIFTED), "translation": SHIFT}, '"translation"'),
}


def _mesh() -> bytes:
    return write.mesh_ply(V, F)


def _case(name: str, content: bytes, **more: Any) -> Case:
    return one(f"handles/{name}", "mesh.ply", _mesh, handles=content, **more)


CASES = [
    *(_case(name, content, expected=(HIGH, LIFTED)) for name, content in LIFTS.items()),
    *(_case(name, content, expected=(index, target)) for name, (content, index, target) in TAKEN.items()),
    *(
        _case(name, content, expected=(HIGH, LIFTED), within=within)
        for name, (content, within) in SOFT.items()
    ),
    *(
        _case(name, given if isinstance(given, bytes) else _file(given), refused=tuple(words))
        for name, (given, *words) in REFUSED.items()
    ),
]

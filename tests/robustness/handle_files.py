"""Cases: handle files and parameters that do not fit the mesh, or themselves."""

import json
from base64 import b64encode

import numpy as np

from sshade.io.meshes import read_arrays
from tests.robustness.case import Case, nothing, refused
from tests.robustness.inputs import BODY, Given, both, cut, data, garbage, handles, text

DEFORM = "sshade deform body.ply pose.json -o out.ply"
YAML = "sshade deform body.ply pose.yaml -o out.ply"
FINE = f"{DEFORM} --vertices 162 --samplings 1"
HELD = {"kind": "static", "vertices": [0, 1, 2]}
P = BODY.V.tolist()


def _moved(*, to: int, count: int = 1) -> dict:
    """A dynamic handle by id."""
    return {"vertices": [50], "target": [(BODY.V[50] + [0, 0, 0.1 * to]).tolist()] * count}


def _target(value: str) -> Given:
    return text("pose.json", f'{{"handles": [{{"vertices": [1], "target": [[0, {value}, 0]]}}]}}')


def _ids(ids: object) -> tuple[Given, str]:
    return handles({"vertices": ids}), "list of integers"


def _entry(*words: str, **entry: object) -> tuple[Given, *tuple[str, ...]]:
    return handles(entry), *words


JSON = {
    "an empty file": (data("pose.json", b""), "pose.json: not readable as JSON"),
    "binary garbage": (garbage("pose.json"), "pose.json: not readable as JSON"),
    "a cut file": (cut("pose.json", 0.6), "pose.json: not readable as JSON"),
    "brackets 100,000 deep": (data("pose.json", b"[" * 100_000), "pose.json: not readable as JSON"),
    "a list": (text("pose.json", "[1, 2]"), '"handles"'),
    "entries that are no objects": (handles(1, 2), "entry 0"),
    "no entries": (handles(), "there are no handles"),
    "an unknown kind": _entry("unknown kind 'moving'", kind="moving", vertices=[1]),
    "neither ids nor positions": _entry('"vertices"', '"source"', kind="static"),
    "a dynamic group without a motion": _entry('no "target"', kind="dynamic", vertices=[1]),
    "fewer targets than handles": _entry("2 handles have 1 targets", vertices=[1, 2], target=[P[1]]),
    "an id beyond the mesh": _entry("0..161, not 162", vertices=[162]),
    "a negative id": _entry("0..161, not -1", vertices=[-1]),
    "ids that are no integers": _ids([1.5]),
    "ids that are true": _entry("true or false in place of a number", vertices=[True, True]),
    "ids of 30 digits": _ids([10**30]),
    "ids in lists of several lengths": _ids([[1], [1, 2]]),
    "no ids in a group": _ids([]),
    "positions of several lengths": _entry("list of points [x, y, z]", source=[[0, 1], [0, 1, 2]]),
    "a position of null": _entry("null in place of a number", source=[[0, 1, None]]),
    "ids that are text": _entry('"vertices" has a text in place of a number', vertices=["1"]),
    "ids of a run that is no pair": _entry("list of pairs [first id, count]", vertices={"runs": [[1, 2, 3]]}),
    "ids in half of an array": _entry(
        'do not fit its "shape"', vertices={"base64": "AAAA", "dtype": "<i4", "shape": [1]}
    ),
    "a number of 400 digits": _entry("too large", source=[[0, 1, 10**400]]),
    "a NaN target": (_target("NaN"), "NaN"),
    "an infinite target": (_target("1e999"), "infinite"),
    "contradictory targets by id": (handles(_moved(to=3), _moved(to=4)), "contradictory targets"),
    "contradictory targets by id in one group": _entry(
        "vertex 50 has contradictory targets", vertices=[50, 50], target=[P[50], P[51]]
    ),
    "contradictory targets by position in one group": _entry(
        "2 positions of group 0 have the same nearest vertex, 50, and contradictory targets",
        source=[P[50], P[50]],
        target=[P[50], P[51]],
    ),
    "a misspelt key": _entry(
        'entry 0: there is no key "wieght"; did you mean "weight"?', wieght=1, vertices=[1]
    ),
    "a key of another program": _entry('no key "comment"', "begin with _", comment="left foot", vertices=[1]),
    "a misspelt key of the file": (
        text("pose.json", '{"handles": [{"vertices": [1]}], "handle": 1}'),
        'no key "handle"; did you mean "handles"?',
    ),
    "a key twice": (
        text("pose.json", '{"handles": [{"vertices": [1], "vertices": [2]}]}'),
        'the key "vertices" occurs twice in one object',
    ),
    "a target and a translation": _entry("either as", vertices=[1], target=[P[1]], translation=[0, 0, 1]),
    "a center without a rotation": _entry('"center" needs', vertices=[1], translation=[0, 0, 1], center=P[1]),
    "swapped corners of a box": _entry("box 0", "axis z", boxes=[[[-9, -9, 9], [9, 9, -9]]]),
    "a static vertex that is also moved": (handles({"vertices": [50]}, _moved(to=3)), "contradictory"),
}
#: Other commands, with the sound files or another suffix.
CALLS = {
    "a missing file": (DEFORM.replace("pose", "nowhere"), nothing, "nowhere.json: no such file"),
    "an unknown suffix": (DEFORM.replace("json", "txt"), garbage("pose.txt"), "'.txt'"),
    "more handles than proxy vertices": (f"{DEFORM} --vertices 10", nothing, "cannot hold"),
}


def _parts(content: str, *, foot: str = "") -> Given:
    """A configuration of Implicit-ARAP with one part, `foot`."""
    return both(text("parts/foot.txt", foot), text("pose.yaml", f"handles: {{{content}}}\n"))


def _static(part: str) -> str:
    return f"static: {{positions: [{part}]}}"


IMPLICIT_ARAP = {
    "binary garbage": (garbage("pose.yaml"), "not readable as YAML"),
    "no mapping": (text("pose.yaml", "- 1\n- 2\n"), "`handles`"),
    "brackets 10,000 deep": (data("pose.yaml", b"[" * 10_000), "not readable as YAML"),
    "a Python object": (
        text("pose.yaml", "handles: !!python/object/apply:os.system ['touch hacked']\n"),
        "not readable as YAML",
    ),
    "a misspelt key": (_parts("static: {position: [foot]}"), 'did you mean "positions"?'),
    "no parts": (_parts("static: {}, moving: {}"), "there are no handles"),
    "parts that are no names": (_parts("static: {positions: 3}"), "list of names"),
    "a missing part": (_parts(_static("hand")), "hand.txt"),
    "a part outside of its folder": (
        both(text("secret.txt", '"password"'), _parts(_static("../secret"))),
        "'../secret' leads out of",
    ),
    "a part by its absolute path": (_parts(_static("/etc/passwd")), "leads out of"),
    "moving parts without transforms": (
        _parts("moving: {positions: [hand]}"),
        "1 moving parts have 0 transforms",
    ),
    "a part that is no table of numbers": (_parts(_static("foot"), foot="a b c\n"), "three numbers"),
    "parts of another mesh": (
        _parts(_static("foot"), foot="0.1 5 5\n0.2 5 5\n0.1 6 5\n0.4 7 5\n"),
        "is this the mesh they were made for?",
    ),
}


def _moved_up() -> None:
    V, _ = read_arrays("out.ply")
    gap = np.abs(V[50] - BODY.V[50] - [0, 0, 0.3]).max() / BODY.diagonal
    assert gap < 0.01, f"{gap:.1%} of the diagonal off"


ALL = BODY.V[:, [1, 2, 0]]
TURN = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
_BYTES = (BODY.V[[50]] + [0, 0, 0.3]).tobytes()
UP = {"base64": b64encode(_BYTES).decode(), "dtype": "<f8", "shape": [1, 3]}
TAKEN = {
    "the same one twice": (handles({"vertices": [0, 1, 2, 2, 1]}, _moved(to=3), _moved(to=3)), _moved_up),
    "keys of one's own": (
        handles({**HELD, "_comment": "left foot"}, {**_moved(to=3), "delta": 1}),
        _moved_up,
    ),
    "UTF-16": (
        data("pose.json", json.dumps({"handles": [HELD, _moved(to=3)]}).encode("utf-16")),
        _moved_up,
    ),
    "translated vertices": (handles({"vertices": [50], "translation": [0, 0, 0.3]}), _moved_up),
    "a box turned about its centre": (
        handles(
            {"boxes": [[P[50], P[50]]], "rotation": TURN, "center": "centroid", "translation": [0, 0, 0.3]}
        ),
        _moved_up,
    ),
    "compact arrays": (
        handles({"vertices": {"runs": [[50, 1]]}, "target": UP}),
        _moved_up,
    ),
    "one alone": (handles(_moved(to=3)), _moved_up),
    "every vertex of the mesh": (
        handles({"vertices": list(range(BODY.n)), "target": ALL.tolist()}),
        lambda: np.testing.assert_allclose(read_arrays("out.ply")[0], ALL, atol=1e-12),
    ),
}
CASES = [
    *refused(DEFORM, JSON, prefix="handles: "),
    *(Case(f"handles: {name}", call, g, says=(word,)) for name, (call, g, word) in CALLS.items()),
    *refused(YAML, IMPLICIT_ARAP, prefix="handles: YAML: "),
    Case("deform --seed -1", f"{DEFORM} --seed -1", says=("seed must be a whole number in [0, inf)",)),
    *(
        Case(f"handles: {name}", FINE, given, leaves=("out.ply",), holds=holds)
        for name, (given, holds) in TAKEN.items()
    ),
]

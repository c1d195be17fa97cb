"""Cases: handle files and parameters that do not fit the mesh, or themselves."""

from __future__ import annotations

import json

import numpy as np

from sshade.io.meshes import read_arrays
from tests.robustness.case import Case, run
from tests.robustness.inputs import BODY, Given, both, cut, data, garbage, handles, text

DEFORM = "sshade deform body.ply pose.json -o out.ply"
YAML = "sshade deform body.ply pose.yaml -o out.ply"
FINE = f"{DEFORM} --vertices 162 --samplings 1"
HELD = {"kind": "static", "vertices": [0, 1, 2]}
P = BODY.V.tolist()


def _refused(name: str, given: Given, *says: str, call: str = DEFORM) -> Case:
    return Case(f"handles: {name}", call, given, says=says)


def _moved(*, to: int, count: int = 1) -> dict:
    """A dynamic handle by id."""
    return {"vertices": [50], "target": [(BODY.V[50] + [0, 0, 0.1 * to]).tolist()] * count}


FILES = [
    _refused(
        "a missing file", lambda: None, "nowhere.json: no such file", call=DEFORM.replace("pose", "nowhere")
    ),
    _refused("an empty file", data("pose.json", b""), "pose.json: not readable as JSON"),
    _refused("binary garbage", garbage("pose.json"), "pose.json: not readable as JSON"),
    _refused("a cut file", cut("pose.json", 0.6), "pose.json: not readable as JSON"),
    _refused("brackets 100,000 deep", data("pose.json", b"[" * 100_000), "pose.json: not readable as JSON"),
    _refused("a list", text("pose.json", "[1, 2]"), 'an object with a list "handles"'),
    _refused("entries that are no objects", handles(1, 2), "entry 0 of handles is no object"),
    _refused("no entries", handles(), "there are no handles"),
    _refused("unused entries alone", handles({"kind": "unused", "vertices": [1]}), "there are no handles"),
    _refused(
        "an unknown suffix",
        garbage("pose.txt"),
        "unknown handle format '.txt'",
        call=DEFORM.replace("json", "txt"),
    ),
    _refused("an unknown kind", handles({"kind": "moving", "vertices": [1]}), "unknown kind 'moving'"),
    _refused("a kind that is no word", handles({"kind": {}, "vertices": [1]}), "unknown kind"),
    _refused("neither ids nor positions", handles({"kind": "static"}), 'either as "vertices" or as "source"'),
    _refused("both ids and positions", handles({"vertices": [1], "source": [P[1]]}), 'either as "vertices"'),
    _refused("a dynamic group without targets", handles({"kind": "dynamic", "vertices": [1]}), 'no "target"'),
    _refused(
        "fewer targets than handles",
        handles({"vertices": [1, 2], "target": [P[1]]}),
        "2 handles have 1 targets",
    ),
    _refused("more targets than handles", handles(HELD, _moved(to=3, count=2)), "1 handles have 2 targets"),
    _refused(
        "fewer targets than positions",
        handles({"source": P[:3], "target": P[:2]}),
        "3 handles have 2 targets",
    ),
    _refused("an id beyond the mesh", handles({"vertices": [162]}), "must lie in 0..161, not 162"),
    _refused("a negative id", handles({"vertices": [-1]}), "must lie in 0..161, not -1"),
    _refused("ids that are no integers", handles({"vertices": [1.5]}), "must be a list of integers"),
    _refused("ids of 30 digits", handles({"vertices": [10**30]}), "must be a list of integers"),
    _refused(
        "ids in lists of several lengths", handles({"vertices": [[1], [1, 2]]}), "must be a list of integers"
    ),
    _refused("ids that are true", handles({"vertices": [True, True]}), "must be a list of integers"),
    _refused("ids that are words", handles({"vertices": "all"}), "must be a list of integers"),
    _refused("no ids in a group", handles({"vertices": []}), "list of integers, at least one"),
    _refused("positions of two coordinates", handles({"source": [[0, 1]]}), "list of points [x, y, z]"),
    _refused(
        "positions of several lengths", handles({"source": [[0, 1], [0, 1, 2]]}), "list of points [x, y, z]"
    ),
    _refused("a position of null", handles({"source": [[0, 1, None]]}), "NaN or infinite"),
    _refused(
        "a NaN target", text("pose.json", '{"handles": [{"vertices": [1], "target": [[NaN, 0, 0]]}]}'), "NaN"
    ),
    _refused(
        "an infinite target",
        text("pose.json", '{"handles": [{"vertices": [1], "target": [[0, 1e999, 0]]}]}'),
        "infinite",
    ),
    _refused("contradictory targets by id", handles(_moved(to=3), _moved(to=4)), "contradictory targets"),
    _refused(
        "contradictory targets by position",
        handles({"source": [P[50]], "target": [[0, 0, 3]]}, {"source": [P[50]], "target": [[0, 0, 4]]}),
        "contradictory targets",
    ),
    _refused(
        "a static vertex that is also moved",
        handles({"vertices": [50]}, _moved(to=3)),
        "contradictory targets",
    ),
    _refused("more handles than proxy vertices", lambda: None, "cannot hold", call=f"{DEFORM} --vertices 10"),
]


def _same_as_sorted() -> None:
    order = np.random.default_rng(0).permutation(BODY.n)[:40]
    target = BODY.V[order] + np.where(BODY.V[order, 2:] > 0, 0.2, 0.0)
    results = []
    for name, chosen in (("a", np.argsort(order)), ("b", np.arange(40))):
        entry = {"vertices": order[chosen].tolist(), "target": target[chosen].tolist()}
        handles(entry)()
        assert run(f"sshade deform body.ply pose.json -o {name}.ply --vertices 60")[0] == 0
        V, _ = read_arrays(f"{name}.ply")
        assert np.abs(V[order] - target).max() < 0.05 * BODY.diagonal
        results.append(V)
    # Another order of the first samples is another sampling: near, not equal.
    assert np.abs(results[0] - results[1]).max() < 0.02 * BODY.diagonal


def _moved_up() -> None:
    V, _ = read_arrays("out.ply")
    gap = np.abs(V[50] - BODY.V[50] - [0, 0, 0.3]).max() / BODY.diagonal
    assert gap < 0.01, f"{gap:.1%} of the diagonal off"


TAKEN = [
    Case("handles: unsorted", _same_as_sorted, leaves=("a.ply", "b.ply", "pose.json")),
    Case(
        "handles: the same one twice",
        FINE,
        handles({"vertices": [0, 1, 2, 2, 1]}, _moved(to=3), _moved(to=3)),
        leaves=("out.ply",),
        holds=_moved_up,
    ),
    Case(
        "handles: more keys than are known",
        FINE,
        both(handles({**HELD, "comment": "left foot"}, {**_moved(to=3), "weight": [1]})),
        leaves=("out.ply",),
        holds=_moved_up,
    ),
    Case(
        "handles: one alone",
        FINE,
        handles(_moved(to=3)),
        leaves=("out.ply",),
        holds=_moved_up,
    ),
    Case(
        "handles: every vertex of the mesh",
        FINE,
        handles({"vertices": list(range(162)), "target": (BODY.V[:, [1, 2, 0]]).tolist()}),
        leaves=("out.ply",),
        holds=lambda: np.testing.assert_allclose(read_arrays("out.ply")[0], BODY.V[:, [1, 2, 0]], atol=1e-12),
    ),
]

IMPLICIT_ARAP = [
    _refused("YAML: empty", data("pose.yaml", b""), "a mapping `handles`", call=YAML),
    _refused("YAML: binary garbage", garbage("pose.yaml"), "not readable as YAML", call=YAML),
    _refused("YAML: no mapping", text("pose.yaml", "- 1\n- 2\n"), "a mapping `handles`", call=YAML),
    _refused(
        "YAML: not closed", text("pose.yaml", "handles: {static: [\n"), "not readable as YAML", call=YAML
    ),
    _refused(
        "YAML: brackets 10,000 deep", data("pose.yaml", b"[" * 10_000), "not readable as YAML", call=YAML
    ),
    _refused(
        "YAML: a Python object",
        text("pose.yaml", "handles: !!python/object/apply:os.system ['touch hacked']\n"),
        "not readable as YAML",
        call=YAML,
    ),
    _refused(
        "YAML: no parts",
        text("pose.yaml", "handles: {static: {}, moving: {}}\n"),
        "there are no handles",
        call=YAML,
    ),
    _refused(
        "YAML: parts that are no names",
        text("pose.yaml", "handles: {static: {positions: 3}}\n"),
        "list of names",
        call=YAML,
    ),
    _refused(
        "YAML: a missing part",
        text("pose.yaml", "handles: {static: {positions: [foot]}}\n"),
        "foot.txt",
        call=YAML,
    ),
    _refused(
        "YAML: a part outside of its folder",
        both(
            text("secret.txt", json.dumps("password")),
            text("pose.yaml", "handles: {static: {positions: [../secret]}}\n"),
        ),
        "'../secret' leads out of",
        call=YAML,
    ),
    _refused(
        "YAML: a part by its absolute path",
        text("pose.yaml", "handles: {static: {positions: [/etc/passwd]}}\n"),
        "leads out of",
        call=YAML,
    ),
    _refused(
        "YAML: moving parts without transforms",
        text("pose.yaml", "handles: {moving: {positions: [hand]}}\n"),
        "1 moving parts have 0 transforms",
        call=YAML,
    ),
    _refused(
        "YAML: a part that is no table of numbers",
        both(
            text("parts/foot.txt", "a b c\n"), text("pose.yaml", "handles: {static: {positions: [foot]}}\n")
        ),
        "each line needs three numbers",
        call=YAML,
    ),
    _refused(
        "YAML: parts of another mesh",
        both(
            text("parts/foot.txt", "0.1 5 5\n0.2 5 5\n0.1 6 5\n0.4 7 5\n"),
            text("pose.yaml", "handles: {static: {positions: [foot]}}\n"),
        ),
        "is this the mesh they were made for?",
        call=YAML,
    ),
]


def _parameter(option: str, *says: str) -> Case:
    return Case(f"deform {option}", f"{DEFORM} {option}", says=says)


PARAMETERS = [
    _parameter("--vertices 0", "cannot hold"),
    _parameter("--vertices -5", "cannot hold"),
    _parameter("--vertices 163", "163 proxy vertices", "the mesh has only 162"),
    _parameter("--samplings 0", "0 samplings", "at least one"),
    _parameter("--samplings -1", "-1 samplings"),
    _parameter("--workers 0", "0 workers", "at least one"),
    _parameter("--seed -1", "seed -1 is negative"),
]
CASES = [*FILES, *TAKEN, *IMPLICIT_ARAP, *PARAMETERS]

"""Mistakes are refused before heavy libraries are imported."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from sshade import Handles
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from tests.robustness.case import assert_refused
from tests.shapes import bumpy

BODY = bumpy(1)
#: A program that runs each command line of a file. It prints the exit code, the error, and whether numba was
#: imported.
CODE = """\
import contextlib, io, json, sys
from sshade.cli.main import main
for line in json.load(open("lines.json")):
    with contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(line.split())
    print(json.dumps([code, err.getvalue(), "numba" in sys.modules]))
"""
HANDLES = {
    "syntax.json": '{"handles": [',
    "quick.json": '{"handles": [{"vertices": [1]}], "made": {"method": "quick"}}',
    "typo.json": '{"handles": [{"vertices": [1]}], "made": {"methd": 0}}',
}
#: Command lines, and words of their errors.
LIGHT = {
    "deform gone.ply pose.json -o a.ply": "gone.ply: no such file",
    "deform body.ply gone.json -o a.ply": "gone.json: no such file",
    "deform body.ply edited.ply -o a.ply": "edited.ply: is a mesh; handles are in a file .json, .yaml",
    "deform pose.json -o a.ply pose.json": "pose.json: is a file of handles; give the mesh first",
    "edit body.ply edited.ply": "edited.ply: is a mesh; handles are in",
    "edit pose.json": "pose.json: is a file of handles; give the mesh first",
    "edit rest.mrk.json": "rest.mrk.json: is a file of handles",
    "deform folder pose.json -o a.ply": "folder: is a folder; give the name of a file",
    "deform body.ply pose.json -o folder": "folder: is a folder; give the name of a file",
    "deform body.ply pose.json -o posed": "posed: its name has no ending, which says the format; use",
    "show body": "body: its name has no ending",
    "show body.fbx pose.json": "Blender converts .fbx from and to .glb",
    "remesh body -o a.ply --map m.npz": "body: its name has no ending",
    "deform body.FBX pose.json -o a.ply": "Blender converts .fbx from and to .glb",
    "deform body.ply pose.json -o a.blend": "unknown format '.blend'; use .ply, .obj, .off, .stl, .glb",
    "deform body.ply syntax.json -o a.ply": "not readable as JSON",
    "deform body.ply pose.txt -o a.ply": "a pose is one handle file, or two landmark files",
    "deform body.ply pose.json -o a.ply --amount 2.5": "the amount goes from 0 to 2, not 2.5",
    "deform pose.json body.ply -o a.ply": "before the handles; did you mean `body.ply pose.json`",
    "edit pose.json body.ply": "pose.json: the mesh comes before the handles",
    "deform body.abc pose.json -o a.ply": "body.abc: unknown format '.abc'; use .ply, .obj, .off, .stl, .glb",
    "deform gone.ply gone.json -o no/a.ply": "the folder no does not exist",
    "deform body.ply pose.json -o a.fbx": "unknown format '.fbx'",
    f"deform body.ply pose.json -o {300 * 'x'}.ply": "File name too long",
    "deform body.ply pose.json -o a.ply --seed -1": "seed must be a whole number of at least 0",
    "deform body.ply pose.json -o a.ply --method paper_plain": "did you mean 'paper'?",
    "deform body.ply pose.json -o a.ply --method FINE": "did you mean 'fine'?",
    "deform body.ply pose.json -o a.ply --detail 0.2": "the option 'detail'; it needs --method fine",
    "deform body.ply pose.json -o a.ply --volume-goal 110": "not 110; it is a ratio, such as 1.1 for 110 %",
    "deform body.ply pose.json -o a.ply --coarser few": "--coarser: 'few' is no number; see",
    "deform body.ply pose.json -o a.ply --weight -2": "--weight takes a number above 0, not -2",
    "deform body.ply quick.json -o a.ply": "quick.json, key \"made\": there is no method 'quick' here",
    "deform body.ply typo.json -o a.ply": "the method 'fast' has no option 'methd'; the options are vertices",
    "reconstruct body.ply body.ply -o a.ply --samplings 0": "samplings must be",
    "carry body.ply gone.npz body.ply -o a.ply": "gone.npz: no such file",
    "remesh gone.ply -o a.ply --map m.npz": "gone.ply: no such file",
    "show body.ply -o a.exr": "'.exr'",
    "show pose.json": "no file is a mesh",
    "show body.ply pose.json pose.json": "show takes one handle file",
    "defrom": "'defrom' is no command; did you mean 'deform'?",
    "deform a.ply b.json -o c.ply --wieght 3": "; did you mean '--weight'?",
    "deform body.ply pose.json": "-o/--output; see `sshade deform --help`",
    "deform body.ply pose.json -o body.ply": "body.ply: is the input body.ply; give another",
    "transfer-pose body.ply body.ply edited.ply -o edited.ply": "edited.ply: is the input edited.ply",
    "edit body.ply pose.json --no-browser --handles-out pose.json": "pose.json: is the input pose.json",
    "edit body.ply --port 70000": "a port is a number up to 65535, not 70000",
    "deform body.ply pose.json pose.json -o out.ply": "out.ply: one such file cannot hold a sequence; number",
    "deform body.ply pose.json pose.json -o out_%d.ply --fps -1": "--fps takes a number above 0",
    "deform body.ply pose.json -o out.ply --fps 10": "--fps applies to sequences",
    "blender -o a.tar": "use .zip",
}
#: Command lines that read whole files. `turned.ply` has the faces of the body in another order.
LATER = {
    "deform damaged.ply pose.json -o a.ply": "damaged.ply: not a readable PLY file",
    "edit body.ply --method paper_plain": "there is no method 'paper_plain' here",
    "carry small.ply map.npz proxy.ply -o a.ply": "42 vertices, this one has 12",
    "carry turned.ply map.npz proxy.ply -o a.ply": "other faces",
    "carry body.ply map.npz small.ply -o a.ply": "small.ply has 12 vertices and the proxy of map.npz has",
    "carry body.ply map.npz nan.ply -o a.ply": "nan.ply: vertex 0 has a NaN",
    "carry body.ply damaged.npz proxy.ply -o a.ply": "not a map written by `sshade remesh` (",
    "show body.ply small.ply -o a.html": "small.ply has 12 vertices",
    "reconstruct body.ply small.ply -o a.ply": "small.ply has 12 vertices and body.ply has 42",
    "deform body.ply pose.json two.json -o out_%d.ply": "two.json: its handles have other vertices",
    "deform body.ply pushed.json -o a.ply": "up to 2e+02 times the diagonal of the mesh; are the units",
    "deform body.ply grown.json -o a.ply": "handles move up to ",
    "deform body.ply rest.csv mm.csv -o a.ply": "are the units right?",
    "deform body_1.ply pose.json -o body_%d.ply": "body_1.ply: is the input body_1.ply",
    "deform body.ply pose.json -o a.ply --with far.ply": "far.ply: 42 of 42 points are too far from the box",
}


def test_mistakes_are_refused_before_numba_is_imported(here):
    """Each in one sentence; nothing is written."""
    write_mesh("body.ply", BODY.V, BODY.F)
    for name in ("pose.txt", "pose.abc", "body.abc", "edited.ply"):
        Path(name).write_bytes(b"")
    for name, content in {**HANDLES, "pose.json": {"vertices": [1]}}.items():
        text = content if isinstance(content, str) else json.dumps({"handles": [content]})
        Path(name).write_text(text)
    Path("folder").mkdir()
    Path("lines.json").write_text(json.dumps(list(LIGHT)))
    before = {path: path.is_dir() or path.read_bytes() for path in Path().rglob("*")}
    environment = {**os.environ, "SSHADE_KERNELS": os.path.abspath("kernels")}
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    for (code, error, has_numba), (line, words) in zip(found, LIGHT.items(), strict=True):
        assert code == 2 and words in error and error.count("\n") == 1, (line, error)
        assert not has_numba, line
    assert {path: path.is_dir() or path.read_bytes() for path in Path().rglob("*")} == before


def test_meshes_and_maps_that_do_not_belong_together_are_refused(here):
    for name in ("body.ply", "body_1.ply"):
        write_mesh(name, BODY.V, BODY.F)
    write_mesh("turned.ply", BODY.V, BODY.F[::-1])
    write_mesh("far.ply", BODY.V + 100, BODY.F)
    write_mesh("small.ply", bumpy(0).V, bumpy(0).F)
    write_handles("pose.json", Handles([1], BODY.V[[1]]))
    write_handles("two.json", Handles([1, 2], BODY.V[[1, 2]], group=[0, 1]))
    assert main(["remesh", "body.ply", "-o", "proxy.ply", "--map", "map.npz", "--vertices", "20"]) == 0
    held = {"kind": "fixed", "vertices": [0]}
    far = [0, 200 * BODY.diagonal, 0]
    for name, motion in {"pushed": {"translation": far}, "grown": {"scale": 1000}}.items():
        entries = [held, {"vertices": [5, 6, 7], **motion}]
        Path(f"{name}.json").write_text(json.dumps({"handles": entries}))
    np.savetxt("rest.csv", BODY.V[:9], delimiter=",")
    np.savetxt("mm.csv", 1000 * BODY.V[:9], delimiter=",")
    V, F = read_arrays("proxy.ply")
    write_mesh("nan.ply", np.where(np.arange(len(V))[:, None] == 0, np.nan, V), F)
    Path("damaged.ply").write_text("ply\n")
    Path("damaged.npz").write_bytes(Path("map.npz").read_bytes()[:-100])
    for line, words in LATER.items():
        assert_refused("sshade", line.split(), words)

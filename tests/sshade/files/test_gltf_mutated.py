"""glTF files with changed numbers are refused in one sentence, or the written file reads back correctly."""

import copy
from pathlib import Path

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.files.meshes import read_file, write_file
from tests.full import few
from tests.gltf import glb, taken_apart
from tests.shapes import bent
from tests.sshade.files.test_gltf import PRIMITIVE, SPHERE, exported, stored

#: Values that replace the numbers of the JSON: mostly NUMBERS for whole numbers, otherwise FLOATS.
NUMBERS = (-1, 0, 1, 2, 3, 4, 5, 6, 12, 16, 24, 36, 40, 44, 52, 100, 162, 480, 5121, 5123, 5125, 5126)
FLOATS = (0.5, -1.0, 1e-3, 1e3, 1e-12, 1e12, 1e30, 1e-30, float("nan"), float("inf"), True, None, "x")
MUTATIONS = 1500


def numbers(tree):
    """Yield, for each number of a JSON document, its key and the object or list that contains it."""
    for key, value in list(tree.items() if isinstance(tree, dict) else enumerate(tree)):
        if isinstance(value, (dict, list)):
            yield from numbers(value)
        elif isinstance(value, (int, float)):
            yield tree, key


def mutated(tree, rng):
    """Change or drop one or two numbers. Some changes make accessors and attributes share bytes."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.integers(1, 3)):
        every = list(numbers(tree))
        holder, key = every[rng.integers(len(every))]
        if rng.random() < 0.1 and isinstance(holder, dict):
            del holder[key]
        else:
            choice = NUMBERS if isinstance(holder[key], int) and rng.random() < 0.9 else FLOATS
            holder[key] = choice[rng.integers(len(choice))]
    return tree


def free(tree, size):
    """Return a mask (b,) of the bytes in the buffer that may change: positions, normals and tangents."""
    found = np.zeros(size, dtype=bool)
    for primitive in (p for mesh in tree["meshes"] for p in mesh["primitives"]):
        for name, width in (("POSITION", 12), ("NORMAL", 12), ("TANGENT", 16)):
            if name in primitive["attributes"]:
                accessor = tree["accessors"][primitive["attributes"][name]]
                view = tree["bufferViews"][accessor["bufferView"]]
                first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
                for i in range(accessor["count"]):
                    begin = first + i * view.get("byteStride", width)
                    found[begin : begin + width] = True
    return found


def unbounded(tree):
    """Return a tree whose accessors lack their bounds."""
    accessors = [{k: v for k, v in one.items() if k not in ("min", "max")} for one in tree["accessors"]]
    return {**tree, "accessors": accessors}


def outcome(tree, buffer):
    """Deform a file and return "refused" or "written"; assert that a written file is correct."""
    path, out = Path("a.glb"), Path("b.glb")
    path.write_bytes(glb(tree, buffer))
    out.unlink(missing_ok=True)
    try:
        file = read_file(path)
        mesh = Mesh(file.V, file.F)
        low, extent = mesh.V.min(axis=0), np.ptp(mesh.V, axis=0).max()
        V = low + extent * bent((mesh.V - low) / extent)
        write_file(out, file, V)
    except InputError as error:
        assert "\n" not in str(error) and not out.exists()
        return "refused"
    again = read_file(out)
    assert np.array_equal(again.F, file.F)
    # The tolerance is single precision, relative to the extent and to the coordinates of the file.
    local = np.frombuffer(buffer, "<f4", 12 * SPHERE.n)
    coarse = np.ptp(V, axis=0).max() + np.abs(file.V).max() + np.abs(local[np.isfinite(local)]).max()
    assert np.abs(again.V - V).max() <= 1e-5 * coarse
    (old, before), (new, after) = (taken_apart(each.read_bytes()) for each in (path, out))
    fixed = ~free(tree, len(before))
    before, after = (np.frombuffer(each, np.uint8)[: len(before)] for each in (before, after))
    assert np.array_equal(before[fixed], after[fixed])
    added = len(new["accessors"]) > len(old["accessors"])
    old, new = unbounded(old), unbounded(new)
    for key in old.keys() - {"nodes", "meshes", "buffers"} if added else old:
        kept = new[key][: len(old[key])] if isinstance(old[key], list) else new[key]
        assert repr(kept) == repr(old[key])
    return "written"


@pytest.mark.parametrize("seed", few(range(4), 0))
def test_changed_numbers_are_refused_or_read_back(here, seed):
    tree, buffer = exported()
    rng = np.random.default_rng(seed)
    found = [outcome(mutated(tree, rng), buffer) for _ in range(MUTATIONS // 4)]
    assert min(found.count("refused"), found.count("written")) > 50


@pytest.mark.parametrize("changes", [{f"{PRIMITIVE}.attributes.NORMAL": 0}, {"accessors.1.byteOffset": 4}])
def test_numbers_that_share_bytes_are_taken_apart(here, changes):
    """Normals use the bytes of the positions, as they may on a unit sphere, or overlap the positions."""
    assert outcome(*exported(**changes)) == "written"


def test_two_sets_of_positions_with_the_same_normals_get_normals_of_their_own(here):
    tree, buffer = exported()
    tree["accessors"].append({**tree["accessors"][0], "bufferView": 4})
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(buffer), "byteLength": 12 * SPHERE.n})
    tree["buffers"][0]["byteLength"] += 12 * SPHERE.n
    attributes = {"POSITION": 6, "NORMAL": 1, "TANGENT": 2}
    tree["meshes"][0]["primitives"].append({"attributes": attributes, "indices": 4})
    assert outcome(tree, buffer + (0.5 * SPHERE.V).astype("<f4").tobytes()) == "written"
    new = taken_apart(Path("b.glb").read_bytes())[0]["meshes"][0]["primitives"]
    assert [list(p["attributes"].values())[:3] for p in new] == [[0, 1, 2], [7, 8, 9]]


def test_a_result_that_single_precision_cannot_hold_is_refused(here):
    skewed = np.eye(4)
    skewed[0, 1] = 1e7
    file = stored(*exported(node={"mesh": 0, "matrix": skewed.T.ravel().tolist()}))
    write_file("b.glb", file, file.V)
    with pytest.raises(InputError, match=r"c\.glb: .*single precision"):
        write_file("c.glb", file, file.V[:, [1, 0, 2]])
    assert not Path("c.glb").exists()

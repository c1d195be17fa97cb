"""Give each mesh that a glTF scene shows positions, normals and tangents of its own.

Files save space: several nodes show one mesh, meshes share accessors, and numbers are quantised.
Vertices that move apart need numbers of their own. New accessors hold them as float32, at the end of the
first buffer. Everything that already has numbers of its own stays where it is.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from sshade.core.errors import counted
from sshade.files.gltf_scene import (
    CHANGED,
    FLOAT,
    Gltf,
    NewAccessors,
    accessor_bytes,
    bounds,
    mesh_matrices,
    node_matrices,
)

#: Fields of an accessor that its copy does not have, or has from its numbers.
_REPLACED = ("bufferView", "byteOffset", "componentType", "count", "type", "normalized")


def with_own_numbers(gltf: Gltf) -> tuple[Gltf, tuple[str, ...]]:
    """Rewrite a file such that each primitive of a mesh may move alone; the scene looks the same.

    Returns
    -------
    gltf : Gltf
    notes : tuple of str
        Notes for the user on rewritten contents.
    """
    gltf = gltf._replace(tree=copy.deepcopy(gltf.tree))
    tree = gltf.tree
    meshes = len(tree.get("meshes", [])) - 1
    instances = _split_instances(tree)
    matrices = mesh_matrices(tree)
    owner = dict[tuple, tuple]()
    #: Accessors to copy, and the attributes of all primitives that share the copies.
    copied: dict[tuple, tuple[dict[str, int], list[dict[str, int]]]] = {}
    converted = 0
    # Meshes that no node shows come last: only others would change their numbers.
    for number in sorted(range(len(tree.get("meshes", []))), key=lambda i: i not in matrices):
        shown = number in matrices
        place = matrices[number].tobytes() if shown else b""
        for primitive in tree["meshes"][number]["primitives"]:
            attributes = primitive["attributes"]
            here = {name: attributes[name] for name in CHANGED if name in attributes}
            keys = {name: accessor_bytes(tree, i) for name, i in here.items()}
            use = (place, max(number, meshes), *keys.items())  # instances share nothing, even at one place
            mine = {key: (name, use) for name, key in keys.items()}
            plain = all(tree["accessors"][i]["componentType"] == FLOAT for i in here.values())
            own = all(owner.get(key, value) == value for key, value in mine.items())
            if own and not (shown and (not plain or len(mine) < len(keys))):
                owner |= mine
                continue
            converted += use not in copied and not plain
            copied.setdefault(use, (here, []))[1].append(attributes)
    primitives = counted(converted, "primitive", "primitives")
    notes = {
        f"{counted(instances, 'node has', 'nodes have')} a mesh that another node has; each gets a mesh of "
        "its own": instances,
        f"quantised positions and normals of {primitives} become float32": converted,
    }
    if copied:
        longer = gltf._replace(buffers=[bytearray(gltf.buffers[0]), *gltf.buffers[1:]])
        new = NewAccessors(longer)
        for here, several in copied.values():
            made = {name: _add_copy(new, gltf, number) for name, number in here.items()}
            for attributes in several:
                attributes |= made
        new.close()
        gltf = longer
    return gltf, tuple(note for note, there in notes.items() if there)


def _add_copy(new: NewAccessors, gltf: Gltf, number: int) -> int:
    """Add a copy of an accessor as float32; normalised whole numbers become numbers in [-1, 1]."""
    accessor = gltf.tree["accessors"][number]
    values = gltf.fractions(number) if accessor.get("normalized") else gltf.array(number)
    floats = values.astype(np.float32)
    kept = {key: value for key, value in accessor.items() if key not in _REPLACED}
    return new.add(floats, kept | bounds(floats, accessor.keys() & {"min", "max"}))


def _split_instances(tree: dict[str, Any]) -> int:
    """Give each node a mesh of its own, behind the meshes of the file; return the number of new meshes.

    Nodes that no scene shows come last.
    """
    shown, taken, instances = node_matrices(tree), set[int](), 0
    nodes = [(number, node) for number, node in enumerate(tree.get("nodes", [])) if "mesh" in node]
    for _, node in sorted(nodes, key=lambda pair: pair[0] not in shown):
        if node["mesh"] in taken:
            tree["meshes"].append(copy.deepcopy(tree["meshes"][node["mesh"]]))
            node["mesh"], instances = len(tree["meshes"]) - 1, instances + 1
        taken.add(node["mesh"])
    return instances

"""glTF files for the tests: put together and taken apart."""

import json

import numpy as np

#: Kind of a component by the type of its array; kind of an element by its width.
COMPONENTS = {"<f4": 5126, "<u4": 5125, "<u2": 5123, "|u1": 5121}
ELEMENTS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
KINDS = {kind: np.dtype(name) for name, kind in COMPONENTS.items()}
WIDTHS = {element: width for width, element in ELEMENTS.items()}


def glb(tree: dict, buffer: bytes) -> bytes:
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    buffer += bytes(-len(buffer) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text
    body += len(buffer).to_bytes(4, "little") + b"BIN\0" + buffer
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body


def taken_apart(data: bytes) -> tuple[dict, bytes]:
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def arrays(tree: dict, buffer: bytes) -> list[np.ndarray]:
    """Return the numbers (k, width) of each accessor; check their alignment, extent and bounds."""
    found = []
    for accessor in tree["accessors"]:
        view, kind = tree["bufferViews"][accessor["bufferView"]], KINDS[accessor["componentType"]]
        width = WIDTHS[accessor["type"]]
        begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        assert begin % kind.itemsize == 0
        stride = view.get("byteStride", width * kind.itemsize)
        assert (accessor["count"] - 1) * stride + width * kind.itemsize <= view["byteLength"]
        assert view.get("byteOffset", 0) + view["byteLength"] <= tree["buffers"][0]["byteLength"]
        array = np.ndarray((accessor["count"], width), kind, buffer, begin, (stride, kind.itemsize))
        for name in accessor.keys() & {"min", "max"}:
            np.testing.assert_array_equal(accessor[name], getattr(array, name)(axis=0).astype(float))
        found.append(array)
    return found


def with_arrays(tree: dict, *arrays: np.ndarray) -> bytes:
    """Return the .glb of a tree whose accessors are the arrays (k, width), with their bounds."""
    views, accessors, data = [], [], b""
    for array in (array.astype(f"<{array.dtype.kind}4") for array in arrays):
        kind = {"componentType": COMPONENTS[array.dtype.str], "type": ELEMENTS[array.shape[1]]}
        bounds = {name: getattr(array, name)(axis=0).tolist() for name in ("min", "max")}
        accessors.append({"bufferView": len(views), "count": len(array), **kind, **bounds})
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes()
    known = {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}]}
    tree = {**known, "accessors": accessors, "bufferViews": views, **tree}
    return glb({**tree, "buffers": [{"byteLength": len(data)}]}, data)

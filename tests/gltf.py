"""glTF files for the tests: put together and taken apart."""

import base64
import json
from pathlib import Path

import numpy as np

#: Kind of a component by the type of its array; kind of an element by its width.
COMPONENTS = {"f": 5126, "u": 5125}
ELEMENTS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


def glb(tree: dict, buffer: bytes, further: bytes = b"") -> bytes:
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    buffer += bytes(-len(buffer) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text
    body += len(buffer).to_bytes(4, "little") + b"BIN\0" + buffer + further
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body


def taken_apart(data: bytes) -> tuple[dict, bytes]:
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def buffer_beside(name: str) -> bytes:
    """Move the buffer of a .gltf file into a .bin file beside it; return its bytes."""
    path = Path(name)
    tree = json.loads(path.read_text())
    data = base64.b64decode(tree["buffers"][0]["uri"].partition(",")[2])
    path.with_suffix(".bin").write_bytes(data)
    tree["buffers"][0]["uri"] = path.with_suffix(".bin").name
    path.write_text(json.dumps(tree))
    return data


def with_arrays(tree: dict, *arrays: np.ndarray) -> bytes:
    """Return the .glb of a tree whose accessors are the arrays (k, width), with their bounds."""
    arrays = [array.astype(f"<{array.dtype.kind}4") for array in arrays]
    begin = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    tree = tree | {
        "asset": {"version": "2.0"},
        "accessors": [
            {
                "bufferView": k,
                "componentType": COMPONENTS[array.dtype.kind],
                "type": ELEMENTS[array.shape[1]],
                "count": len(array),
                "min": array.min(axis=0).tolist(),
                "max": array.max(axis=0).tolist(),
            }
            for k, array in enumerate(arrays)
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": begin[k], "byteLength": array.nbytes}
            for k, array in enumerate(arrays)
        ],
        "buffers": [{"byteLength": begin[-1]}],
    }
    return glb(tree, b"".join(array.tobytes() for array in arrays))

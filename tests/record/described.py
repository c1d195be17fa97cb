"""Describe values and files in lines of text that can be recorded and compared.

An array becomes its dtype, its shape and a digest: its largest number, and two sums with fixed weights over
the norm of the weights. Whole numbers have a checksum. Both sums of a shape change by about the relative
change of its coordinates.
"""

import base64
import csv
import dataclasses
import gzip
import json
import math
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eval.run.environment import environment
from sshade import InputError, Mesh
from sshade.files.meshes import read_arrays

#: Files that are read as meshes, and files whose text is recorded.
MESHES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf", ".3mf", ".dae", ".vtp", ".vtu", ".vtk")
#: Longest text that is recorded as it is, in lines and in characters of a line; others have a digest.
LINES, LONG = 24, 250
#: Longest mesh file, in bytes, of which the text is recorded beside the arrays.
SHORT = 900
NUMBER = re.compile(r"(?<![A-Za-z_#])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
#: What differs from run to run or from version to version, and what stands in its place.
VARYING = (
    (re.compile(r"\b\d+(\.\d+)? ?(s|ms|us|min|MiB|GiB|MB|GB|kB)\b"), "<some> "),
    (re.compile(r"\b20\d\d-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?(\+\d\d:\d\d|Z)?)?"), "<date>"),
    (re.compile(r"(?<![0-9A-Za-z])(?=[a-f]*[0-9])(?=[0-9]*[a-f])[0-9a-f]{8,64}(?![0-9A-Za-z])"), "<hash>"),
    (re.compile(r"[A-Za-z0-9+/]{120,}=*"), "<data>"),
    (re.compile(r" \(with changes\)|(?<=<dt>modified</dt><dd>)\w+"), ""),  # of the checkout
    (re.compile(r"Commit: [0-9a-f]{8}"), "Commit: <hash>"),  # also of digits alone
    (re.compile(r"Shortest mean time: [^<\n]*"), "<shortest time>"),
    (re.compile(r"about \d+:\d\d:\d\d left"), "<some> left"),
)
MACHINE = environment(jobs=1)
#: Fields and columns that are times, or facts of the machine and of the version.
TIMES = re.compile(
    r"seconds|cpu|memory|date|env|hash|key|version|commit|machine|measured|bytes|sha256|checksum|peak|^tools"
)


def steady(text: str) -> str:
    """Return a text without times, dates, checksums and the working folder."""
    for own, word in ((str(Path.cwd()), "."), (MACHINE["machine"], "<machine>"), (MACHINE["cpu"], "<cpu>")):
        text = text.replace(own, word)
    for pattern, word in VARYING:
        text = pattern.sub(word, text)
    return text


def digest(array: np.ndarray) -> str:
    """Return the dtype, the shape and a digest of an array."""
    head = f"{array.dtype} {list(array.shape)}"
    if array.dtype.kind != "f":
        return f"{head} #{zlib.crc32(np.ascontiguousarray(array).astype(str).tobytes()):08x}"
    values = array.astype(float).ravel()
    finite = np.isfinite(values)
    scale = float(np.abs(values[finite]).max(initial=0.0))
    lost = "" if finite.all() else f" {np.count_nonzero(~finite)} not finite"
    if scale == 0:
        return f"{head} zero{lost}"
    angle = np.arange(values.size) * (math.sqrt(5) - 1) / 2
    weights = np.stack([1 + 0.5 * np.cos(angle), np.sin(7 * angle + 1)]) / math.sqrt(values.size)
    sums = weights @ np.where(finite, values, 0.0) / scale
    return f"{head} scale {scale:.4g} @{sums[0]:.7f} @{sums[1]:.7f}{lost}"


def described(value: Any, name: str = "") -> Iterator[str]:
    """Yield ``name = value`` for a value, or for its fields, entries and items."""
    if isinstance(value, Mesh):
        yield f"{name}.V = {digest(value.V)}"
        yield f"{name}.F = {digest(value.F)}"
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            own = getattr(value, field.name)
            yield from described(
                list(own) if field.name == "seconds" else own, f"{name}.{field.name}".lstrip(".")
            )
    elif isinstance(value, Mapping):
        for key, item in value.items():
            own = f"{name}.{key}".lstrip(".")
            yield from [f"{own}"] if TIMES.search(str(key)) else described(item, own)
        if not value:
            yield f"{name} = {{}}"
    elif isinstance(value, np.ndarray):
        yield f"{name} = {digest(value) if value.ndim else plain(value[()])}"
    elif isinstance(value, Sequence) and not isinstance(value, str):
        if all(isinstance(item, (int, float, str)) for item in value) and len(value) < 12:
            yield f"{name} = {list(map(plain, value))}"
        else:
            for number, item in enumerate(value):
                yield from described(item, f"{name}[{number}]")
    else:
        yield f"{name} = {plain(value)}"


def plain(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.6g}"
    return steady(repr(value.item() if isinstance(value, np.generic) else value))


def text_lines(text: str) -> list[str]:
    """Return the lines of a short text; of a long one its words and numbers as digests."""
    lines = [line.rstrip() for line in steady(text).splitlines()]
    if len(lines) <= LINES and max(map(len, lines), default=0) <= LONG:
        return lines
    text = "\n".join(lines)
    numbers = np.arcsinh(1e4 * np.array([float(word) for word in NUMBER.findall(text)]))
    return [f"{len(lines)} lines #{zlib.crc32(NUMBER.sub('', text).encode()):08x}, numbers {digest(numbers)}"]


def file_lines(path: Path) -> list[str]:
    """Return what a file holds."""
    suffix, content = path.suffix.lower(), path.read_bytes()
    if suffix in MESHES:
        try:
            V, F = read_arrays(path)
        except InputError as error:  # a sequence as morph targets, which no command deforms
            return [f"not read: {steady(str(error))}", *_beside(suffix, content)]
        return [f"V {digest(V)}", f"F {digest(F)}", *_beside(suffix, content)]
    if suffix in (".npz", ".npy"):
        with np.load(path, allow_pickle=False) if suffix == ".npz" else open(path, "rb") as file:
            arrays = {name: file[name] for name in file.files} if suffix == ".npz" else {"": np.load(file)}
        return list(described(arrays))
    if suffix == ".csv":
        return _columns(content.decode())
    if suffix == ".zip":
        return zipfile.ZipFile(path).namelist()
    if suffix == ".json":
        lines = list(described(json.loads(content)))
        return lines if len(lines) <= LINES else text_lines("\n".join(lines))
    if suffix in (".png", ".pdf", ".jpg"):
        return ["a picture"]
    if suffix == ".html":  # whose times are among its numbers, and in its charts
        text = content.decode()
        words = re.sub(r"[\d.,+-]+", "", re.sub(r"<svg.*?</svg>", "<chart>", steady(text), flags=re.DOTALL))
        lines = described(shown, "shows") if (shown := figure_facts(text)) else ()
        return [f"{words.count(chr(10))} lines #{zlib.crc32(words.encode()):08x}", *lines]
    return text_lines(content.decode())


def figure_facts(page: str) -> dict[str, Any]:
    """Return what the page of a figure shows; {} for another page."""
    cases, *data = re.findall(r'id="turn-(?:cases|data-0)"[^>]*>(.*?)</script>', page, re.DOTALL) or [""]
    if '"id": "figure"' not in cases:
        return {}
    (shown,) = json.loads(cases)["cases"]
    shown |= {name: np.array(shown[name]) for name in ("handles", "dynamic", "targets")}
    packed = gzip.decompress(base64.b64decode(data[0]))
    return shown | {"data": np.frombuffer(packed, "<u2") / 1.0}


def _beside(suffix: str, content: bytes) -> list[str]:
    """What a mesh file holds beside positions and faces; the whole text if it is short."""
    if len(content) < SHORT and b"\0" not in content and len(content.splitlines()) <= LINES:
        return text_lines(content.decode())
    if suffix == ".ply":
        return ["; ".join(content[: content.find(b"end_header")].decode().splitlines()[1:])]
    if suffix == ".glb":
        size = int.from_bytes(content[12:16], "little")
        tree = json.loads(content[20 : 20 + size])
        lines = [line for line in described(tree) if not re.search(r"\.(min|max)\b|^buffer", line)]
        numbers = np.frombuffer(content[28 + size : len(content) // 4 * 4], np.float32)
        return [*lines, f"numbers {digest(np.where(np.abs(numbers) < 1e6, numbers, 0))}"]
    if suffix == ".gltf":
        return [line for line in described(json.loads(content)) if not re.search(r"\.(min|max|uri)\b", line)]
    if suffix in (".obj", ".off"):
        kinds = [line.split(" ")[0] for line in content.decode().splitlines() if not line[:1].isdigit()]
        found = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds) if not NUMBER.match(kind)}
        beside = re.findall(r"^(?:vt|vn) (.*)", content.decode(), re.MULTILINE)
        digests = [f"vt and vn {digest(np.array(' '.join(beside).split(), float))}"] if beside else []
        return [f"lines {found}", *digests]
    if suffix == ".stl":
        return [repr(content[:80].rstrip(b"\0 "))]
    return []


def _columns(text: str) -> list[str]:
    """The columns of a table: numbers as digests, words as they are."""
    rows = list(csv.reader(text.splitlines()))
    found = []
    for name, *cells in zip(*rows, strict=True):
        if TIMES.search(name):
            found.append(name)
        else:
            words = cells if len(cells) <= 3 else [f"{len(cells)} cells", *dict.fromkeys(cells)][:6]
            found.append(f"{name}: {steady(', '.join(words))[:LONG]}")
    return found

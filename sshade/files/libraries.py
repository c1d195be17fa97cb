"""The lines "mtllib" of OBJ files: names of .mtl files, which name textures."""

from __future__ import annotations

from pathlib import Path

from sshade.files.mesh_file import beside, goes_along, moved_reference

#: How lines of a .mtl file with a texture begin.
_MAPS = ("map_", "bump", "disp", "decal", "refl", "norm")


def moved_library(line: bytes, source: Path, path: Path) -> bytes:
    """Convert the names of a line "mtllib" so that they are valid in `path`."""
    names = library_names(line)
    # Materials go along with all their textures, or stay where they are.
    moved = [
        name
        if all(goes_along(file, source, path) for file in _files_of(name, source))
        else moved_reference(name, source, path, along=False)
        for name in names
    ]
    if moved == names:
        return line
    end = len(line.partition(b"#")[0].rstrip())
    return b"mtllib " + " ".join(moved).encode("utf-8", "surrogateescape") + line[end:]


def library_names(line: bytes) -> list[str]:
    """Return the names in a line "mtllib". Blanks separate them, but a single name may contain blanks."""
    text = rest_of(line.partition(b"#")[0])
    return [text] if text.lower().count(".mtl") == 1 else text.split()


def library_files(line: bytes, source: Path) -> list[str]:
    """Return the names of the .mtl files in a line "mtllib" of `source`, and of their textures."""
    return [file for name in library_names(line) for file in _files_of(name, source)]


def _files_of(name: str, source: Path) -> list[str]:
    """Return the name of a .mtl file and the names of its textures that are there, as from `source`."""
    library = beside(source, name)
    lines = library.read_text("utf-8", "surrogateescape").splitlines() if library.is_file() else []
    words = [line.split() for line in lines if line.strip().lower().startswith(_MAPS)]
    textures = [str(beside(beside(Path(source.name), name), texture_name(rest))) for _, *rest in words]
    return [name, *(file for file in dict.fromkeys(textures) if beside(source, file).is_file())]


def rest_of(line: bytes) -> str:
    """Return what follows the keyword of a line."""
    rest = line.split(None, 1)[1:]
    return rest[0].strip().decode("utf-8", "surrogateescape") if rest else ""


def texture_name(words: list[str]) -> str:
    """Return the file name behind the options of a texture, such as ``-s 1 1 1``."""
    while words and words[0].startswith("-"):
        words = words[1:]
        while len(words) > 1 and (words[0] in ("on", "off") or _is_number(words[0])):
            words = words[1:]
    return " ".join(words)


def _is_number(word: str) -> bool:
    return word.replace(".", "", 1).lstrip("+-").isdecimal()

"""Compare lines with recorded ones: words exactly, numbers within what another processor changes."""

from collections.abc import Sequence
from difflib import SequenceMatcher, unified_diff

from tests.record.described import NUMBER

#: Largest difference of digests, which are about 1 for the size of a shape.
DIGESTS = 1e-4
#: Relative difference of other numbers with a point, and of numbers of iterations and of frequent calls.
RELATIVE, COUNTS = 0.03, 0.25
#: Numbers below are residuals and rounding: those of one size are equal.
TINY, ZERO, SIZE = 1e-4, 1e-9, 10.0
#: Relative difference of memory, and the megabytes that depend on what was loaded before.
MEMORY, MEGABYTES = 0.04, 0.8
#: Beginnings of the lines of a transcript that are given.
GIVEN = (">", "$ ", "@ ", "% ")
#: Up to this number, calls are counted exactly.
FEW = 8


def same(line: str, recorded: str) -> bool:
    """Whether a line says what the recorded one says; what a transcript is given is exact."""
    if line == recorded:
        return True
    if line.startswith(GIVEN) or NUMBER.sub("0", line) != NUMBER.sub("0", recorded):
        return False
    if line.startswith("peak of "):
        a, b = (float(NUMBER.findall(text)[0]) for text in (line, recorded))
        return abs(a - b) <= max(MEGABYTES, MEMORY * b)
    counts = "iterations" in line or "calls" in line
    found, before = NUMBER.finditer(line), NUMBER.finditer(recorded)
    return all(
        _near(a[0], b[0], digest=line[: a.start()].endswith("@"), counts=counts)
        for a, b in zip(found, before, strict=True)
    )


def _near(word: str, other: str, *, digest: bool, counts: bool) -> bool:
    a, b = float(word), float(other)
    gap, size = abs(a - b), max(abs(a), abs(b))
    if digest:
        return gap <= DIGESTS
    if counts:
        return gap <= (COUNTS * size if size > FEW else 0)
    if word.lstrip("+-").isdigit() and other.lstrip("+-").isdigit():
        return a == b
    digits = max(len(number.partition(".")[2]) for number in (word, other))
    unit = 1.01 * 10.0**-digits if "e" not in word + other else 0.0
    return (
        gap <= max(unit, RELATIVE * size)
        or size < ZERO
        or (size < TINY and size <= SIZE * min(abs(a), abs(b)))
    )


def settled(lines: Sequence[str], recorded: Sequence[str]) -> list[str]:
    """Return the lines, as recorded where they are the same but for what another processor changes."""
    found = list(lines)
    blocks = SequenceMatcher(None, *map(_patterns, (recorded, lines)), autojunk=False).get_matching_blocks()
    for old, new, size in blocks if len(lines) != len(recorded) else [(0, 0, len(lines))]:
        for k in range(size):
            if same(lines[new + k], recorded[old + k]):
                found[new + k] = recorded[old + k]
    return found


def _patterns(lines: Sequence[str]) -> list[str]:
    return [line if line.startswith(GIVEN) else NUMBER.sub("0", line) for line in lines]


def differences(lines: Sequence[str], recorded: Sequence[str]) -> list[str]:
    """Return the lines that differ from the recorded ones, as a diff; [] if none does."""
    return list(unified_diff(recorded, settled(lines, recorded), "recorded", "found", lineterm="", n=1))

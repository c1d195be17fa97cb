"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def markdown_table(
    labels: Sequence[str], body: Iterable[Iterable[str]], *, left: Collection[str] = ()
) -> str:
    """Return a table; columns labelled in `left` are aligned left, the others right."""
    sides = ["---" if label in left else "---:" for label in labels]
    lines = (" | ".join(cell.replace("|", r"\|") for cell in cells) for cells in (labels, sides, *body))
    return "\n".join(f"| {line} |" for line in lines)

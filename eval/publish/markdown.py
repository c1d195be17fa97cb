"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def markdown_lines(
    labels: Sequence[str], body: Iterable[Iterable[str]], *, left: Collection[str] = ()
) -> list[str]:
    """Return the lines of a table; columns labelled in `left` are aligned left, the others right."""
    sides = ["---" if label in left else "---:" for label in labels]
    return [f"| {' | '.join(cells)} |" for cells in (labels, sides, *body)]

"""Blocks of a page that a script writes: everything between ``<!-- NAME -->`` and ``<!-- end -->``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from eval.publish.columns import markdown_table


def filled(text: str, blocks: dict[str, str]) -> str:
    """Return the text of a page with other contents of its blocks.

    Raises
    ------
    ValueError
        If the page does not have a block exactly once.
    """
    for name, content in blocks.items():
        start, end = f"<!-- {name} -->\n", "\n<!-- end -->"
        block = re.compile(f"(?<={start}).*?(?={end})", re.DOTALL)
        text, count = block.subn(lambda _, new=content: new, text)
        if count != 1:
            raise ValueError(f"the page has {count} blocks {name!r}; it must have one")
    return text


def fill(page: Path, blocks: dict[str, str]) -> None:
    """Rewrite blocks of a page."""
    page.write_text(filled(page.read_text(encoding="utf-8"), blocks), encoding="utf-8")


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; all columns but the first are aligned as numbers."""
    return markdown_table(head, rows, left=head[:1])


def circumstances(rows: pd.DataFrame) -> str:
    """Return the machine and the commit of rows of times, and how busy the machine was."""
    (machine,), (commit,) = rows["machine"].unique(), rows["commit"].unique()
    usual, most = rows["others"].median(), rows["others"].max()
    note = f"Machine: {machine}. Commit {commit[:8]}. "
    return note + f"Other processes used {usual:.0%} of the machine (median); the maximum was {most:.0%}."

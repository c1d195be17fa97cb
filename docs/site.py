"""Hooks of mkdocs: add linked files from outside ``docs`` to the website, and render formulas.

Pages of ``docs`` link to other files of the repository by relative paths (``../results/tables/quick.md``),
which work in a clone. On the website, linked files appear under ``files/``: Markdown files as pages, others
unchanged. ``$...$`` and ``$$...$$`` become MathML, which browsers draw without a script.
"""

from __future__ import annotations

import gzip
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]

LINK = re.compile(r"(\]\()([^)#\s]+)(#[^)\s]*)?(\))")
FENCE = re.compile(r"(^ *```.*?^ *```|`[^`\n]+`)", re.M | re.S)
DISPLAY = re.compile(r"\$\$(.+?)\$\$", re.S)
INLINE = re.compile(r"(?<![\\$\w])\$((?:[^$\n]|\n(?!\n))+?)\$(?![\w$])")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add turning views, and the files that pages link to outside ``docs``, with all that these link to."""
    for path in (ROOT / "docs" / "figures").glob("turn_*.html.gz"):
        page = gzip.decompress(path.read_bytes())
        files.append(File.generated(config, f"figures/{path.stem}", content=page))
    todo = list(files.documentation_pages())
    while todo:
        file = todo.pop()
        for _, link, *_ in LINK.findall(Path(file.abs_src_path).read_text(encoding="utf-8")):
            target = _target(file.src_uri, link)
            name = f"files/{target}"
            if target and not _is_in_docs(target) and files.get_file_from_path(name) is None:
                new = File.generated(config, name, abs_src_path=str(ROOT / target))
                files.append(new)
                if name.endswith(".md"):
                    todo.append(new)
    return files


def _is_in_docs(target: str) -> bool:
    """Whether mkdocs adds a file by itself. The configuration excludes scripts and the lab notebook."""
    return target.startswith("docs/") and not target.endswith((".py", "/notebook.md"))


def _target(uri: str, link: str) -> str | None:
    """Return the path of the file that a link of a page leads to, or None if it is not in the repository."""
    here = uri.removeprefix("files/") if uri.startswith("files/") else f"docs/{uri}"
    path = posixpath.normpath(posixpath.join(posixpath.dirname(here), link))
    return path if "://" not in link and (ROOT / path).is_file() else None


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite links and formulas of a page, except in code."""
    here = page.file.src_uri

    def relink(found: re.Match[str]) -> str:
        start, link, anchor, end = found.groups()
        target = _target(here, link)
        if target is None:
            return found[0]
        there = target.removeprefix("docs/") if _is_in_docs(target) else f"files/{target}"
        there = there.removesuffix(".gz")  # turning views
        return f"{start}{posixpath.relpath(there, posixpath.dirname(here) or '.')}{anchor or ''}{end}"

    parts = FENCE.split(markdown)
    for k in range(0, len(parts), 2):
        text = LINK.sub(relink, parts[k])
        text = DISPLAY.sub(lambda m: convert(m[1].strip(), display="block"), text)
        parts[k] = INLINE.sub(lambda m: f"<span>{convert(m[1].strip())}</span>", text)
    return "".join(parts)

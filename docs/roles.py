"""Docstrings of the code for the site: roles such as ``:func:`x``` become links, where the site has x."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

ROLE = re.compile(r":(?:func|class|mod|data|meth|attr):`(~?)([\w.]+)`")


class Roles(Extension):
    """Rewrites the docstring of each object that is read."""

    def on_instance(self, *, obj: Object, **_: Any) -> None:
        """Called with each module, class, function and attribute."""
        if obj.docstring:
            obj.docstring.value = ROLE.sub(_link, obj.docstring.value)


def _link(found: re.Match[str]) -> str:
    short, name = found.groups()
    text = name.rsplit(".", 1)[-1] if short else name
    return f'<autoref identifier="{name}" optional><code>{text}</code></autoref>'

"""Turn roles such as ``:func:`x``` in docstrings into links, if the website documents x."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

ROLE = re.compile(r":(?:func|class|mod|data|meth|attr):`(~?)([\w.]+)`")


class Roles(Extension):
    """A griffe extension that rewrites the docstring of each object."""

    def on_instance(self, *, obj: Object, **_: Any) -> None:
        """Rewrite the docstring of a module, class, function or attribute."""
        if obj.docstring:
            obj.docstring.value = ROLE.sub(_link, obj.docstring.value)


def _link(found: re.Match[str]) -> str:
    short, name = found.groups()
    text = name.rsplit(".", 1)[-1] if short else name
    return f'<autoref identifier="{name}" optional><code>{text}</code></autoref>'

"""Pages that node plays with actions of a user, without a browser: see ``tests/record/node``."""

import json
import os
import subprocess
from contextlib import ExitStack
from functools import cached_property
from importlib.resources import files
from pathlib import Path

from sshade.edit.session import Session
from tests.sshade.edit.lent import lent

PLAYER = Path(__file__).parent / "node" / "player.js"
SCRIPT = files("sshade.edit") / "page" / "page.js"
#: The line that ends an answer of the player.
END = ".\n"


class Page:
    """A page of the editor, or a page in a file, and the actions of a user on it."""

    def __init__(self) -> None:
        self._player, self._server = ExitStack(), ExitStack()

    def __enter__(self):
        return self

    def __exit__(self, *_) -> None:
        self._server.close()
        self._player.close()

    @cached_property
    def _node(self) -> subprocess.Popen:
        """The player, in the node that playwright brings."""
        from playwright._impl._driver import compute_driver_executable

        line = [compute_driver_executable()[0], "--no-warnings", PLAYER]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "encoding": "utf-8"}
        node = self._player.enter_context(subprocess.Popen(line, env=os.environ | {"TZ": "UTC"}, **pipes))
        self._player.callback(node.stdin.close)
        return node

    def show(self, shown: Session | str, graphics: str = "card") -> list[str]:
        """Open the page of a session, a file or a text; "" is no graphics card. Return what the page does."""
        self._server.close()
        self.about, address, script = shown, shown, ""
        if isinstance(shown, Session):
            address, script = self._server.enter_context(lent(shown)).address, str(SCRIPT)
        self._opened = f"open {json.dumps([address, script, graphics])}"
        return self.play(self._opened)

    def play(self, line: str) -> list[str]:
        """Play a line of actions; return what they do."""
        print(self._opened if line == "reload" else line, file=self._node.stdin, flush=True)
        lines = []
        while (said := self._node.stdout.readline()) != END:
            assert said, "the player has ended"
            lines.append(said.rstrip())
        return lines

"""A session lent to one browser of this machine, over HTTP.

The page is our own, over the standard library's server, and needs no further package. One that brings a
scene of its own, such as viser, sends whole meshes where 12 bytes a vertex do, picks no vertices by brush or
lasso, and answers any page of the browser. A page asks for one step of a drag after the other, so that no
more are under way than it can draw. What a websocket would add, messages that nobody asked for, one answer
gives that never ends: how far a computation is and, when it breaks off, that the page is closed.

Whoever is answered knows the token in the address, came to this machine by its own name (the Host, which a
name that was bound anew to 127.0.0.1 does not give), and is not sent by a page of another origin.
"""

from __future__ import annotations

import json
import logging
import secrets
import socket
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from select import select
from threading import Condition, Thread
from time import monotonic
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from sshade import threejs
from sshade.edit.commands import Commands
from sshade.edit.saving import FileExists
from sshade.edit.session import Session, Superseded
from sshade.errors import InputError

log = logging.getLogger(__name__)

#: Files of the page and their types.
PAGE = {
    "": ("index.html", "text/html"),
    "style.css": ("style.css", "text/css"),
    "view.js": ("view.js", "text/javascript"),
    "picking.js": ("picking.js", "text/javascript"),
    "panel.js": ("panel.js", "text/javascript"),
    "page.js": ("page.js", "text/javascript"),
}
#: What every answer says: nothing from elsewhere, in no other page, to be kept nowhere.
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
#: Bytes of a request at most, beside those of a list of all vertices.
LARGEST = 100_000_000
#: Seconds between signs of life to a page, after the last page was closed, and for a request to come whole.
BEAT, GRACE, PATIENCE = 0.5, 3.0, 60.0


class Server(ThreadingHTTPServer):
    """Serves an editor on 127.0.0.1, until its page is closed or says that it is done.

    Parameters
    ----------
    session : Session
    port : int
        0 for any that is free.

    Attributes
    ----------
    address : str
        To be opened in a browser.

    Raises
    ------
    OSError
        When the port is taken.
    """

    daemon_threads = True

    def __init__(self, session: Session, *, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(24)
        self.commands, self.vertices = Commands(session), session.mesh.n
        super().__init__(("127.0.0.1", port), _Handler)
        self.hosts = {f"{name}:{self.server_port}" for name in ("127.0.0.1", "localhost")}
        self.address = f"http://127.0.0.1:{self.server_port}/{self.token}/"
        self._changed = Condition()
        self._stage: dict[str, Any] | None = None
        self._pages, self._closed = 0, False

    def progress(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Tell the page how far a computation is."""
        with self._changed:
            self._stage = {"stage": stage, "done": done, "total": total, "note": note}
            self._changed.notify_all()

    def close(self) -> None:
        """End :meth:`serve_forever`; from any thread, and more than once."""
        with self._changed:
            already, self._closed = self._closed, True
            self._changed.notify_all()
        if not already:
            Thread(target=self.shutdown, daemon=True).start()

    def stages(self, write: Any) -> None:
        """Call `write` with each stage that is new, and else now and then, until the page is gone."""
        with self._changed:
            self._pages += 1
        last = None
        try:
            while not self._closed:
                with self._changed:
                    if self._stage is last:
                        self._changed.wait(BEAT)
                    stage, new, last = self._stage, self._stage is not last, self._stage
                write((json.dumps(stage) if new else "").encode() + b"\n")
        finally:
            with self._changed:
                self._pages -= 1
            if not self._closed:
                self._end_unless_it_comes_back()

    def _end_unless_it_comes_back(self) -> None:
        """A page that is loaded anew is gone for a moment only."""
        end = monotonic() + GRACE
        with self._changed:
            back = self._changed.wait_for(lambda: self._pages > 0, timeout=max(0.0, end - monotonic()))
        if not back:
            self.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that hangs up is no error."""
        log.debug("a connection broke off", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    #: Answers are written at once; waiting for more would cost a drag some 40 ms a step.
    disable_nagle_algorithm = True
    timeout = PATIENCE
    server_version, sys_version = "sshade", ""

    def do_GET(self) -> None:
        name = self._allowed()
        if name is None:
            return
        if name in PAGE:
            file, kind = PAGE[name]
            text = files("sshade.edit").joinpath("page", file).read_text(encoding="utf-8")
            self._send(HTTPStatus.OK, text.encode(), f"{kind}; charset=utf-8")
        elif name == "three.js":
            self._send(HTTPStatus.OK, threejs.source().encode(), "text/javascript; charset=utf-8")
        elif name == "whole":
            self._packet(lambda: self.server.commands.whole(self._query()))
        elif name == "alive":
            self._alive()
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        name = self._allowed()
        if name is None:
            return
        content = self._content()
        if content is None:
            return
        commands, query = self.server.commands, self._query()
        if name == "select":
            if len(content) % 4:
                self._refuse(HTTPStatus.BAD_REQUEST, "vertices are sent as 4 bytes each")
                return
            vertices = np.frombuffer(content, dtype="<u4").astype(np.int64)
            self._packet(lambda: commands.select(vertices, query.get("how", "")))
        elif name == "open":
            self._packet(lambda: commands.open(content, query.get("name", "the file")[:200]))
        elif name == "quit":
            self._send(HTTPStatus.OK, b"{}", "application/json")
            self.server.close()
        else:
            try:
                given = json.loads(content or b"{}")
            except (ValueError, RecursionError):
                self._refuse(HTTPStatus.BAD_REQUEST, "a command comes as JSON")
                return
            self._packet(lambda: commands(name, given, self.server.progress))

    def _query(self) -> dict[str, str]:
        return dict(parse_qsl(urlsplit(self.path).query))

    def _allowed(self) -> str | None:
        """The name that is asked for; None, and an answer, for whom may not ask."""
        hosts = self.server.hosts
        origins = {f"http://{host}" for host in hosts}
        # A link to the page, in a terminal that is a page itself, may be followed.
        visited = self.command == "GET" and self.headers.get("Sec-Fetch-Dest") == "document"
        _, token, *rest = [*urlsplit(self.path).path.split("/", 2), ""]
        own = (
            self.headers.get("Host") in hosts
            and self.headers.get("Origin", f"http://{self.headers.get('Host')}") in origins
            and (self.headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin") or visited)
            and secrets.compare_digest(token.encode(), self.server.token.encode())
        )
        if own:
            return rest[0]
        self._refuse(HTTPStatus.FORBIDDEN, "this address is of no editor: open the one that it printed")
        return None

    def _content(self) -> bytes | None:
        """The body; None, and an answer, where its length is missing or too large."""
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdecimal() or "Transfer-Encoding" in self.headers:
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "the request does not say how long it is")
            return None
        if len(length) > 12 or int(length) > LARGEST + 4 * self.server.vertices:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"at most {LARGEST:,} bytes are taken")
            return None
        content = self.rfile.read(int(length))
        if len(content) < int(length):
            self.close_connection = True
            return None
        return content

    def _packet(self, answer: Any) -> None:
        """Send what a command answers, or why it does not, in a sentence."""
        try:
            self._send(HTTPStatus.OK, answer(), "application/octet-stream")
        except FileExists as error:
            self._refuse(HTTPStatus.CONFLICT, str(error), exists=True)
        except Superseded:
            self._refuse(HTTPStatus.CONFLICT, "the handles have changed meanwhile", superseded=True)
        except (InputError, FloatingPointError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except MemoryError:
            self._refuse(HTTPStatus.INSUFFICIENT_STORAGE, "there is not enough memory")
        except OSError:  # the browser hung up
            raise
        except Exception:  # the page must not wait for ever; the person is told where to look
            log.exception("the editor failed")
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, "the editor failed; the terminal tells why")

    def _alive(self) -> None:
        self.send_response(HTTPStatus.OK)
        for name, value in {**HEADERS, "Content-Type": "text/plain; charset=utf-8"}.items():
            self.send_header(name, value)
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        self.server.stages(self._beat)

    def _beat(self, line: bytes) -> None:
        """Write a line; an OSError tells that the page is gone."""
        readable, _, _ = select([self.connection], [], [], 0)
        if readable and not self.connection.recv(1, socket.MSG_PEEK):
            raise ConnectionResetError
        self.wfile.write(line)

    def _refuse(self, status: HTTPStatus, sentence: str, **facts: Any) -> None:
        self.close_connection = True  # what is left of the request is not read
        self._send(status, json.dumps({"error": sentence, **facts}).encode(), "application/json")

    def _send(self, status: HTTPStatus, content: bytes, kind: str) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(content))}.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *given: Any) -> None:
        """Requests are not told: the address has the token."""

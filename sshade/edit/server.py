"""HTTP server that connects a session with one page in a browser of this machine.

The server uses the standard library alone. Viewers such as viser send whole meshes where 12 bytes per vertex
suffice, have no brush or lasso, and answer any page of the browser. The page asks for the next step of a
drag when it has the last one, so that it draws every computed step. The request "progress"
reports the progress of computations, and that the program still runs. A page that is closed may come back at
any time.

The server answers a request only if the address contains the secret token, the Host header names this
machine (which protects against DNS rebinding), and no page of another origin sent the request.
"""

from __future__ import annotations

import json
import logging
import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from threading import Thread
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from sshade.core.errors import InputError, reason
from sshade.edit.commands import Commands
from sshade.edit.document import FileExists
from sshade.edit.session import Session
from sshade.edit.workspace import Superseded
from sshade.plotting import threejs

log = logging.getLogger(__name__)

#: Files of the page and their types, by the last part of the address.
PAGE = {"": ("index.html", "text/html"), "style.css": ("style.css", "text/css")}
SCRIPTS = ("view", "picking", "look", "panel", "page")
PAGE |= {f"{name}.js": (f"{name}.js", "text/javascript") for name in SCRIPTS}
#: Methods of :class:`Commands` that answer to a request alone, and to a request with a query.
ANSWERS, ANSWERS_TO_QUERIES = ("whole", "colours", "skin"), ("image",)
#: Headers of every answer: load nothing from elsewhere, stay out of other pages, cache nothing.
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
#: Seconds until an incomplete request is dropped.
PATIENCE = 60.0


class Server(ThreadingHTTPServer):
    """Serve an editor on 127.0.0.1 until a page ends it or :meth:`close` is called.

    Parameters
    ----------
    session : Session
    port : int
        0 selects a free port.

    Attributes
    ----------
    session : Session
    address : str
        Address to open in a browser.
    stage : str
        What the current computation does, if it does not compute; empty otherwise.

    Raises
    ------
    InputError
        When the port is in use.
    """

    daemon_threads = True

    def __init__(self, session: Session, *, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(24)
        self.session = session
        self.commands = Commands(session, self.progress)
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise InputError(f"port {port} of this machine cannot be used ({reason(error)})") from error
        self.hosts = {f"{name}:{self.server_port}" for name in ("127.0.0.1", "localhost")}
        self.address = f"http://127.0.0.1:{self.server_port}/{self.token}/"
        self.stage = ""

    def progress(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Note that a computation goes on, after a compilation."""
        self.stage = ""

    def compiling(self, _: str) -> None:
        """Tell the page of a compilation."""
        self.stage = "preparing, once, for up to half a minute"

    def close(self) -> None:
        """End :meth:`serve_forever`. Any thread may call this, also repeatedly."""
        Thread(target=self.shutdown, daemon=True).start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore lost connections, which browsers cause all the time."""
        log.debug("a connection was lost", exc_info=True)


class _Refused(Exception):
    """A request is refused, with this status and sentence."""


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    #: Send answers at once. Nagle's algorithm would add about 40 ms to each step of a drag.
    disable_nagle_algorithm = True
    timeout = PATIENCE
    server_version, sys_version = "sshade", ""

    def do_GET(self) -> None:
        """Answer a request, or say why it is refused."""
        try:
            (self._get if self.command == "GET" else self._post)(self._allowed())
        except _Refused as error:
            self._refuse(*error.args)
        except FileExists as error:
            self._refuse(HTTPStatus.CONFLICT, str(error), exists=True)
        except Superseded:
            self._refuse(HTTPStatus.CONFLICT, "the handles changed during the computation", superseded=True)
        except (InputError, FloatingPointError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except MemoryError:
            self._refuse(HTTPStatus.INSUFFICIENT_STORAGE, "there is not enough memory")
        except OSError:  # the browser closed the connection
            raise
        except Exception:  # the page must not wait for ever
            log.exception("the editor failed")
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, "the editor failed; its terminal shows the error")

    do_POST = do_GET

    def _get(self, name: str) -> None:
        if name in PAGE:
            file, kind = PAGE[name]
            text = files("sshade.edit").joinpath("page", file).read_text(encoding="utf-8")
            self._send(text.encode(), f"{kind}; charset=utf-8")
        elif name == "three.js":
            self._send(threejs.source().encode(), "text/javascript; charset=utf-8")
        elif name in ANSWERS:
            self._send(getattr(self.server.commands, name)())
        elif name in ANSWERS_TO_QUERIES:
            self._send(getattr(self.server.commands, name)(self._query))
        elif name == "progress":
            self._send(json.dumps(self.server.stage).encode(), "application/json")
        else:
            raise _Refused(HTTPStatus.NOT_FOUND, f"the editor has no page {name!r}")

    def _post(self, name: str) -> None:
        commands, content = self.server.commands, self._content()
        if name == "select":
            vertices = np.frombuffer(content, dtype="<u4").astype(np.int64)
            self._send(commands.select(vertices, self._query["how"]))
        elif name == "quit":
            self._send(b"{}", "application/json")
            self.server.close()
        else:
            answer = commands(name, json.loads(content or b"{}"))
            self.server.stage = ""
            self._send(answer)

    @property
    def _query(self) -> dict[str, str]:
        return dict(parse_qsl(urlsplit(self.path).query))

    def _allowed(self) -> str:
        """Return the requested name, or refuse the request."""
        hosts = self.server.hosts
        origins = {f"http://{host}" for host in hosts}
        # The user may follow a link to the page, also in a terminal that is itself a page.
        visited = self.command == "GET" and self.headers.get("Sec-Fetch-Dest") == "document"
        _, token, *rest = [*urlsplit(self.path).path.split("/", 2), ""]
        if (
            self.headers.get("Host") in hosts
            and self.headers.get("Origin", f"http://{self.headers.get('Host')}") in origins
            and (self.headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin") or visited)
            and secrets.compare_digest(token.encode(), self.server.token.encode())
        ):
            return rest[0]
        raise _Refused(HTTPStatus.FORBIDDEN, "wrong address: open the address that the editor printed")

    def _content(self) -> bytes:
        """Return the body."""
        length = int(self.headers["Content-Length"])
        content = self.rfile.read(length)
        if len(content) < length:
            raise ConnectionResetError
        return content

    def _refuse(self, status: HTTPStatus, sentence: str, **facts: Any) -> None:
        self.close_connection = True  # the rest of the request is not read
        self._send(json.dumps({"error": sentence, **facts}).encode(), "application/json", status)

    def _send(
        self, content: bytes, kind: str = "application/octet-stream", status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(content))}.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Do not log requests, because their address contains the token."""

"""An editor's server in this process, and how to ask it."""

import json
import struct
from contextlib import contextmanager
from http.client import HTTPConnection
from threading import Thread

import numpy as np

from sshade.edit.server import Server
from sshade.edit.session import Session


@contextmanager
def lent(session: Session):
    """A server of a session, running."""
    server = Server(session)
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    with server:
        try:
            yield server
        finally:
            server.close()
            thread.join(10)
            assert not thread.is_alive()


def ask(server: Server, method: str, path: str, body: bytes | None = None, **headers: str | None):
    """Status, headers and content of an answer; by default as the page asks. None leaves a header out."""
    host = f"127.0.0.1:{server.server_port}"
    given = {"Host": host, "Origin": f"http://{host}", "Sec-Fetch-Site": "same-origin"}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection = HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    try:
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        if body is not None and "Content_Length" not in headers:
            given["Content-Length"] = str(len(body))
        for name, value in given.items():
            if value is not None:
                connection.putheader(name, value)
        connection.endheaders(body)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def command(server: Server, name: str, given=None):
    """What a command is answered: its facts, with the arrays by name; or status and error."""
    body = json.dumps({} if given is None else given).encode()
    status, _, content = ask(server, "POST", f"/{server.token}/{name}", body)
    return unpacked(content) if status == 200 else {"status": status, **json.loads(content)}


def whole(server: Server) -> dict:
    """What a page asks for first."""
    return unpacked(ask(server, "GET", f"/{server.token}/whole", Origin=None)[2])


def unpacked(content: bytes) -> dict:
    (size,) = struct.unpack_from("<I", content)
    facts = json.loads(content[4 : 4 + size])
    at = 4 + size
    for name, kind, count in facts.pop("arrays"):
        assert at % 4 == 0
        facts[name] = np.frombuffer(content, np.dtype(kind).newbyteorder("<"), count, at)
        at += -(-facts[name].nbytes // 4) * 4
    assert at == len(content)
    return facts

"""The server of the editor: accepted and refused requests, errors, and the stage of a compilation."""

import logging
from pathlib import Path

import pytest

from sshade.edit.server import PAGE, Server
from tests.sshade.edit.lent import ask, command, lent
from tests.sshade.edit.sessions import BODY, begun

pytestmark = pytest.mark.usefixtures("here")


@pytest.fixture
def server():
    with lent(begun()) as running:
        yield running


def state(server: Server):
    return server.session.state


def test_the_page_is_sent_whole_and_takes_nothing_from_elsewhere(server):
    for name, (_, kind) in {**PAGE, "three.js": ("", "text/javascript")}.items():
        status, headers, content = ask(server, "GET", f"/{server.token}/{name}", Origin=None)
        assert status == 200 and len(content) > 500 and headers["Content-Type"].startswith(kind)
        assert headers["Content-Security-Policy"].startswith("default-src 'none'")
        assert headers["X-Content-Type-Options"] == "nosniff" and headers["Referrer-Policy"] == "no-referrer"
        assert headers["Cache-Control"] == "no-store"
        assert "Access-Control-Allow-Origin" not in headers and "Set-Cookie" not in headers
        if name != "three.js":
            assert b"http://" not in content and b"https://" not in content
    assert server.server_address[0] == "127.0.0.1"
    with Server(server.session) as other:
        assert other.token != server.token and len(server.token) >= 32


FOREIGN = [{"Origin": origin} for origin in ("http://evil.example", "null", "http://127.0.0.1:1")]
FOREIGN += [{"Host": "evil.example:{port}", "Origin": None}, {"Host": "127.0.0.1"}, {"Host": None}]
FOREIGN += [{"Sec_Fetch_Site": "cross-site"}]


@pytest.mark.parametrize("headers", FOREIGN)
def test_other_origins_and_names_are_refused(server, headers):
    own = {name: value and value.format(port=server.server_port) for name, value in headers.items()}
    before = state(server)
    posts = [("POST", "select?how=invert", b""), ("POST", "quit", b"")]
    for method, path, body in [("GET", "whole", None), *posts]:
        status, _, content = ask(server, method, f"/{server.token}/{path}", body, **own)
        assert status == 403 and BODY.V.astype("<f4").tobytes()[:12] not in content
        assert server.token.encode() not in content
    assert state(server) is before
    link = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "document", "Origin": None}
    assert ask(server, "GET", f"/{server.token}/", **link)[0] == 200  # it still runs, and a link is let in


@pytest.mark.parametrize("path", ["/", "/{short}/", "/{token}x/", "/?{token}", "/../{token}/"])
def test_without_the_token_nothing_is_answered(server, path):
    path = path.format(token=server.token, short=server.token[:-1])
    assert ask(server, "GET", path)[0] == ask(server, "POST", path, b"{}")[0] == 403


def test_what_is_refused_and_an_error_of_the_program_are_told_in_a_sentence(server, monkeypatch, caplog):
    answer = command(server, "save", {"what": "handles", "name": "x.json"})
    assert answer["status"] == 400 and "no handles" in answer["error"] and not Path("x.json").exists()

    def broken(*_):
        raise ZeroDivisionError("inside")

    monkeypatch.setattr(server.session, "undo", broken)
    with caplog.at_level(logging.ERROR):
        answer = command(server, "undo")
    assert answer == {"status": 500, "error": "the editor failed; its terminal shows the error"}
    assert "ZeroDivisionError" in caplog.text


def test_a_compilation_is_told_until_the_next_answer(server):
    server.compiling("")
    assert b"preparing, once" in ask(server, "GET", f"/{server.token}/progress")[2]
    command(server, "undo")
    assert ask(server, "GET", f"/{server.token}/progress")[2] == b'""'

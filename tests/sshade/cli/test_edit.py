"""`sshade edit` as a process: the printed address, the ways to end it, and refused mistakes."""

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest

from sshade.cli.main import main
from tests.robustness.case import assert_refused
from tests.robustness.inputs import BODY
from tests.sshade.edit.lent import unpacked

pytestmark = pytest.mark.usefixtures("sound")


@contextmanager
def running(*arguments: str):
    """Run the command; yield its process and the address that it prints."""
    line = [sys.executable, "-m", "sshade", "edit", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    if os.name != "nt":  # background jobs of a shell ignore SIGINT, and children inherit this
        pipes["preexec_fn"] = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
    process = subprocess.Popen(line, text=True, **pipes)
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


def get(address: str, body: bytes | None = None) -> bytes:
    with urllib.request.urlopen(address, body, timeout=20) as answer:
        return answer.read()


def mark(address: str, kind: str) -> None:
    """Make a group of the first vertex."""
    get(f"{address}select?how=replace", b"\0\0\0\0")
    get(f"{address}mark", json.dumps({"kind": kind}).encode())


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGINT for another process")
def test_it_prints_its_address_alone_and_ends_by_an_interrupt():
    with running("body.ply", "pose.json", "--no-browser") as (process, address):
        assert address.startswith("http://127.0.0.1:") and address.endswith("/")
        assert b"<title>sshade edit</title>" in get(address)
        facts = unpacked(get(f"{address}whole"))
        assert facts["mesh"]["vertices"] == BODY.n
        assert [group["kind"] for group in facts["groups"]] == ["fixed", "moved"]
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 0 and out == "" and "Traceback" not in err and "not saved" not in err


@pytest.mark.skipif(os.name == "nt", reason="Windows ends programs without a signal")
def test_it_ends_by_sigterm_at_once_and_says_what_was_not_saved():
    with running("body.ply", "--no-browser") as (process, address):
        mark(address, "fixed")
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 143 and out == "" and "Traceback" not in err
    (kept,) = Path().glob("body.ply.recovery-*.npz")
    assert err.endswith(f"note: the handles were not saved; {kept} keeps them for the next start\n")


def test_a_browser_opens_at_the_address_with_the_method_that_a_handle_file_was_saved_with(
    monkeypatch, capsys
):
    begun, opened = [], []
    monkeypatch.setattr("sshade.cli.edit.webbrowser.open", lambda address: opened.append(address) or False)
    monkeypatch.setattr("sshade.edit.server.Server.serve_forever", lambda self, **_: begun.append(self))
    monkeypatch.setattr("sshade.edit.server.Server.close", lambda self: None)
    saved = json.loads(Path("pose.json").read_text()) | {"made": {"method": "fine"}}
    Path("pose.json").write_text(json.dumps(saved))
    assert main(["edit", "body.ply", "pose.json"]) == 0
    out, err = capsys.readouterr()
    assert opened == [out.strip()] and "no browser could be opened" in err
    assert main(["edit", "body.ply", "--no-browser"]) == 0
    assert len(opened) == 1
    assert [server.session.state.method for server in begun] == ["fine", "fast"]


def test_a_port_that_is_in_use_is_told():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        line = ["edit", "body.ply", "--no-browser", "--port", str(other.getsockname()[1])]
        assert_refused("sshade", line, "cannot be used")

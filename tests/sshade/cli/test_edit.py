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

import numpy as np
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


def test_a_browser_opens_with_the_saved_method_and_unsaved_handles_are_told(monkeypatch, capsys):
    methods, opened = [], []

    def serve(server, **_) -> None:
        methods.append(server.session.state.made)
        server.session.select(np.array([0]), "replace")
        server.session.mark("fixed")
        raise KeyboardInterrupt

    monkeypatch.setattr("sshade.cli.edit.webbrowser.open", lambda address: opened.append(address) or False)
    monkeypatch.setattr("sshade.edit.server.Server.serve_forever", serve)
    monkeypatch.setattr("sshade.edit.server.Server.close", lambda self: None)
    saved = json.loads(Path("pose.json").read_text()) | {"made": {"method": "fine", "joints": 0}}
    Path("pose.json").write_text(json.dumps(saved))
    assert main(["edit", "body.ply", "pose.json"]) == 0
    out, err = capsys.readouterr()
    assert opened == [out.strip()] and "no browser could be opened" in err
    (kept,) = Path().glob("body.ply.recovery-*.npz")
    assert err.endswith(f"note: the handles were not saved; {kept} keeps them for the next start\n")
    assert main(["edit", "body.ply", "--no-browser"]) == 0
    assert len(opened) == 1 and methods == [{"method": "fine", "joints": 0}, {"method": "fast"}]


def test_a_port_that_is_in_use_is_told():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        line = ["edit", "body.ply", "--no-browser", "--port", str(other.getsockname()[1])]
        assert_refused("sshade", line, "cannot be used")

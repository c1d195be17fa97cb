"""sshade.edit_handles: it waits for the page, and returns handles at vertices of the mesh."""

import re
import socket
import subprocess
import sys
from math import inf
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import trimesh

import sshade
from sshade import DeformationTask, Handles, InputError
from sshade.edit import from_python as call
from sshade.files.meshes import write_mesh
from tests.shapes import bumpy, torn
from tests.sshade.edit.lent import ask, command, mark, whole
from tests.sshade.edit.sessions import BODY, HIGH, LOW

pytestmark = pytest.mark.usefixtures("here")


@pytest.fixture
def user(monkeypatch):
    """Acts on the server as a page does when the browser opens: user(act) calls act(server) in a thread."""
    servers, failures = [], []

    class Kept(call.Server):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            servers.append(self)

    def acts(act):
        def run():
            try:
                act(servers[-1])
            except BaseException as error:
                failures.append(error)
            finally:
                servers[-1].close()

        def opened(address):
            assert address == servers[-1].address
            Thread(target=run).start()
            return True

        monkeypatch.setattr(call.webbrowser, "open", opened)

    monkeypatch.setattr(call, "Server", Kept)
    yield acts
    assert failures == []


def mark_and_lift(server, high=HIGH):
    """Fix the lower end, and move others up by a tenth of the diagonal."""
    number = mark(server, LOW, high)
    still = {"pivot": [0, 0, 0], "quaternion": [0, 0, 0, 1], "move": [0, 0, 0.1]}
    assert "error" not in command(server, "release", {"group": number, **still})


def test_it_returns_the_groups_of_the_page_and_leaves_no_files(user, capsys):
    def act(server):
        said = whole(server)
        assert said["returns"] and said["mesh"]["vertices"] == BODY.n and said["settings"]["method"] == "fine"
        mark_and_lift(server)
        assert len(list(Path().glob("mesh_*.ply.recovery-*.npz"))) == 1
        status, _, _ = ask(server, "POST", f"/{server.token}/quit", b"")
        assert status == 200

    user(act)
    handles = sshade.edit_handles(BODY, method="fine")
    assert handles.index.tolist() == [*LOW, *HIGH]
    assert np.array_equal(handles.target[: len(LOW)], BODY.V[LOW])
    np.testing.assert_allclose(handles.target[len(LOW) :], BODY.V[HIGH] + [0, 0, 0.1 * BODY.diagonal])
    assert handles.dynamic.tolist() == [False] * len(LOW) + [True] * len(HIGH)
    assert handles.group.tolist() == [0] * len(LOW) + [1] * len(HIGH)
    assert "http://127.0.0.1:" in capsys.readouterr().out and list(Path().iterdir()) == []
    assert DeformationTask("posed", BODY, handles).mesh is BODY


def test_handles_that_it_begins_with_come_back_with_everything(user):
    index = np.array([*LOW, *HIGH])
    moves = np.isin(index, HIGH)
    rotation = np.full((len(index), 3, 3), np.nan)
    rotation[moves] = np.eye(3)
    weight = np.where(moves, 3.0, inf)
    target = BODY.V[index] + [[0, 0, 0.1]] * moves[:, None]
    begun = Handles(index, target, dynamic=moves, group=5 * moves, weight=weight, rotation=rotation)
    user(lambda server: None)
    ended = sshade.edit_handles(BODY, begun)
    for name in ("index", "target", "dynamic", "weight", "rotation"):
        assert np.array_equal(getattr(ended, name), getattr(begun, name), equal_nan=name == "rotation"), name
    assert (ended.group == moves).all()


def test_copies_along_a_seam_all_have_handles(user):
    V, F, seam = torn(BODY)
    shape = trimesh.Trimesh(V, F, process=False)
    copies = np.arange(len(V) - len(seam), len(V))
    before = np.array(shape.vertices)

    def act(server):
        mark_and_lift(server, seam - 1)  # the first vertex of the arrays has no face

    user(act)
    handles = sshade.edit_handles(shape)
    moved = handles.index[handles.dynamic]
    assert set(moved) == {*seam, *copies} and 0 not in handles.index
    at = {int(v): p for v, p in zip(handles.index, handles.target, strict=True)}
    assert all(np.array_equal(at[int(a)], at[int(b)]) for a, b in zip(seam, copies, strict=True))
    posed = sshade.deform(shape, handles.index, handles.target)
    np.testing.assert_allclose(posed.vertices[seam], posed.vertices[copies])
    assert np.array_equal(shape.vertices, before) and shape.vertices.flags.writeable


def test_an_interrupt_returns_the_handles(user, monkeypatch):
    def interrupted(server, **_):
        raise KeyboardInterrupt

    user(lambda server: None)
    monkeypatch.setattr(call.Server, "serve_forever", interrupted)
    begun = Handles(LOW, BODY.V[LOW])
    assert sshade.edit_handles(BODY, begun).index.tolist() == LOW.tolist()


def test_a_killed_session_is_offered_to_the_next_call_with_the_same_mesh(user, monkeypatch):
    monkeypatch.setattr("sshade.edit.recovery._is_running", lambda process: False)
    folder = Path()

    def killed(server):
        mark_and_lift(server)
        (kept,) = folder.glob("*.npz")
        kept.with_name(kept.name.replace("recovery-", "recovery-0")).write_bytes(kept.read_bytes())

    def act(server):
        assert len(whole(server)["recovery"]) == 1
        command(server, "recover")

    user(killed)
    first = sshade.edit_handles(BODY)
    user(act)
    again = sshade.edit_handles(BODY)
    assert np.array_equal(again.index, first.index) and np.array_equal(again.target, first.target)
    assert list(folder.iterdir()) == []
    user(lambda server: whole(server)["recovery"] == [] or pytest.fail("offered for another mesh"))
    sshade.edit_handles(bumpy(2), Handles([0], bumpy(2).V[:1]))


def test_saved_handles_are_read_for_the_mesh_by_the_line_that_the_page_shows(user):
    saved = Path("mine.json").resolve()

    def act(server):
        mark_and_lift(server)
        said = command(server, "save", {"what": "handles", "name": "mine.json"})
        assert said["command"] == (f"import sshade; handles = sshade.read_handles({str(saved)!r}, mesh)")

    user(act)
    handles = sshade.edit_handles(BODY)
    from sshade.files.task_files import read_handles

    read = read_handles("mine.json", BODY)
    assert np.array_equal(read.index, handles.index) and np.array_equal(read.target, handles.target)


def test_a_browser_returns_the_handles_to_a_process_of_python(browser):
    write_mesh("body.ply", BODY.V, BODY.F)
    lines = [
        "import sshade, webbrowser",
        "webbrowser.open = lambda address: False",
        "mesh = sshade.Mesh(*sshade.read('body.ply'))",
        "handles = sshade.edit_handles(mesh, sshade.Handles([7, 3], mesh.V[[7, 3]], group=[0, 1]))",
        "print(handles.index.tolist(), handles.group.tolist())",
    ]
    line = [sys.executable, "-c", "\n".join(lines)]
    with subprocess.Popen(line, text=True, stdout=subprocess.PIPE) as process:
        try:
            address = re.search(r"http://\S+", process.stdout.readline())[0]
            page = browser.new_page()
            page.on("dialog", lambda dialog: pytest.fail(dialog.message))
            page.goto(address)
            page.wait_for_selector("#stage[data-state=converged]")
            page.get_by_role("button", name="Delete").click()
            page.locator("#groups li").nth(1).wait_for(state="detached")
            page.get_by_role("button", name="Return to Python").click()
            page.get_by_text("Python goes on with the handles; this page can be closed.").wait_for()
            page.close()
            out, _ = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 0 and out.strip() == "[7] [0]"


@pytest.mark.parametrize(
    ("mesh", "options", "words"),
    [
        ("body.ply", {}, "takes a mesh, not an object of type str"),
        (BODY.V, {}, "not an object of type ndarray; of arrays make sshade.Mesh"),
        (BODY, {"handles": [1, 2]}, "handles are an sshade.Handles, not an object of type list"),
        (BODY, {"handles": Handles([10_000], [[0, 0, 0]])}, "handle id 10000 is out of range"),
        (BODY, {"method": "fats"}, "did you mean 'fast'"),
        (BODY, {"up": "x"}, 'up is "y" or "z"'),
        (BODY, {"port": 70_000}, "a port is a number from 0 to 65535"),
        (BODY, {"port": "taken"}, "cannot be used"),
        (BODY, {}, "there are no handles"),
    ],
)
def test_a_mistake_is_one_sentence(user, mesh, options, words):
    user(lambda server: None)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        if options.get("port") == "taken":
            options = {"port": other.getsockname()[1]}
        with pytest.raises(InputError, match=words) as raised:
            sshade.edit_handles(mesh, **options)
    assert "\n" not in str(raised.value) and list(Path().iterdir()) == []

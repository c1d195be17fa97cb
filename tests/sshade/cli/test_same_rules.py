"""All commands, the editor, tasks and Python take and refuse the same meshes."""

import numpy as np
import pytest

from sshade import Handles, InputError, deform
from sshade.cli.main import PROGRAM, main
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import read_task, write_handles
from sshade.problem.options import described
from tests.shapes import bent, beside, bumpy, shifted, torn
from tests.sshade.edit.sessions import edited
from tests.sshade.mesh.test_cutting import moebius, t_fin

BODY = bumpy(2)
V, F = BODY.V, BODY.F
SEAM = torn(BODY)[:2]
NEAR = np.where(np.arange(len(SEAM[0]))[:, None] < BODY.n, SEAM[0], SEAM[0] + 5e-10 * BODY.diagonal), SEAM[1]
TOP, BOTTOM = int(np.argmax(V[:, 2])), int(np.argmin(V[:, 2]))
TWO_FANS = beside(BODY, shifted(BODY, V[TOP] - V[BOTTOM]))
TAKEN = {
    "clean": (V, F),
    "vertices in no face": (np.concatenate([[[9.0, 9, 9]], V]), F + 1),
    "a seam with rounding": NEAR,
    "an edge of three faces": (t_fin().V, t_fin().F),
    "two fans at a vertex": (TWO_FANS.V, np.where(BODY.n + BOTTOM == TWO_FANS.F, TOP, TWO_FANS.F)),
    "a face twice": (V, np.concatenate([F, F[:1]])),
    "faces turned": (V, np.concatenate([F[:9, ::-1], F[9:]])),
    "one side": (moebius().V, moebius().F),
    "a face of no extent": (np.vstack([V, np.ones((3, 3))]), np.vstack([F, len(V) + np.arange(3)])),
    "no width": (V * [0, 0, 1], F),
    "triangles that share no vertex": (V[F].reshape(-1, 3), np.arange(F.size).reshape(-1, 3)),
}
COMMANDS = (
    "deform rest.ply pose.json -o out.ply --vertices 60",
    "show rest.ply pose.json rest.ply -o out.html",
    "remesh rest.ply -o proxy.ply --map map.npz --vertices 60",
    "carry rest.ply map.npz proxy.ply -o carried.ply",
    "reconstruct rest.ply rest.ply -o rebuilt.ply --vertices 60 --samplings 2",
    "transfer-pose rest.ply rest.ply rest.ply -o transferred.ply --vertices 60 --samplings 2",
)
REFUSED = {
    "a NaN": (np.where(np.arange(len(V))[:, None] == 3, np.nan, V), F),
    "a face of vertices that are missing": (V, np.concatenate([F, [[0, 1, 999]]])),
    "one place": (np.ones_like(V), F),
    "faces that are points": (np.repeat(V[F].mean(axis=1), 3, axis=0), np.arange(F.size).reshape(-1, 3)),
    "no face with three vertices": (V, np.column_stack([F[:, 0], F[:, 0], F[:, 1]])),
}


@pytest.fixture
def refusals(here, capsys):
    """The reason why each command refuses a mesh; "" where it takes the mesh."""
    write_mesh("body.ply", V, F)
    assert main([*COMMANDS[2].replace("rest", "body").split()]) == 0
    capsys.readouterr()

    def found(V: np.ndarray, F: np.ndarray) -> dict[str, str]:
        write_mesh("rest.ply", V, F)
        used = np.unique(F[len(V) > F])[[0, -1]]
        target = np.nan_to_num(V)[used] + [[0, 0, 0], [0.1, 0, 0]]
        write_handles("pose.json", Handles(used, target))
        reason = {}
        for command in COMMANDS:
            code = main(command.split())
            said = capsys.readouterr().err
            assert code == (2 if said.startswith("error: ") else 0), said
            reason[command] = said.removeprefix("error: ").rstrip() if code else ""
        for name, call in {
            "the editor": lambda: edited("rest.ply", begin="pose.json"),
            "a task": lambda: read_task("rest.ply", handles="pose.json"),
            "Python": lambda: deform(V, F, used, target, vertices=60),
        }.items():
            try:
                call()
                reason[name] = ""
            except InputError as error:
                reason[name] = str(error)
        return {name: why.removeprefix("rest.ply: ") for name, why in reason.items()}

    return found


@pytest.mark.parametrize("name", TAKEN)
def test_every_command_takes(name, refusals):
    reason = refusals(*TAKEN[name])
    assert set(reason.values()) == {""}, {command: why for command, why in reason.items() if why}
    rest, _ = read_arrays("rest.ply")
    for output, most in (("carried.ply", 1e-6), ("rebuilt.ply", 0.2), ("transferred.ply", 0.2)):
        away = np.abs(read_arrays(output)[0] - rest).max() / BODY.diagonal
        assert away < most, f"{output} is {away:.2g} of the diagonal from the shape at rest"


@pytest.mark.parametrize("name", REFUSED)
def test_every_command_refuses(name, refusals):
    reason = refusals(*REFUSED[name])
    assert len(set(reason.values())) == 1 and "" not in reason.values(), reason


def test_every_command_welds_and_repairs(here, capsys):
    """Two bodies that touch in a vertex are one component after a repair alone."""
    V, F = TWO_FANS.V + 1e-8 * (np.arange(TWO_FANS.n) >= BODY.n)[:, None], TWO_FANS.F
    write_mesh("rest.ply", V, F)
    write_handles("pose.json", Handles([0, 9], V[[0, 9]] + [[0, 0, 0], [0.1, 0, 0]]))
    session = edited("rest.ply", begin="pose.json", weld=1e-6, repair=True)
    task = read_task("rest.ply", handles="pose.json", weld=1e-6, repair=True)
    assert session.mesh.n == task.mesh.n == len(V) - 1
    for command in COMMANDS:
        assert main([*command.split(), "--repair", "--weld", "1e-6"]) == 0
    session.save("handles", "rest_handles.json")
    assert main(session.document.command.split()[1:]) == 0
    capsys.readouterr()
    assert main(COMMANDS[3].split()) == 2 and "the --weld and --repair that" in capsys.readouterr().err
    assert main([*COMMANDS[0].split(), "--refuse-unconstrained"]) == 2


#: Another value than the default for each option of proxies.
OTHER = {"vertices": "30", "samplings": "1", "frames": "blended", "seed": "1"}


@pytest.mark.parametrize("line", COMMANDS[2:], ids=lambda line: line.split()[0])
def test_every_option_of_a_command_counts(line, here):
    """Also an option that is new. The number of threads changes no result."""
    write_mesh("rest.ply", V, F)
    assert main(COMMANDS[2].split()) == 0
    proxy, faces = read_arrays("proxy.ply")
    write_mesh("proxy.ply", bent(proxy), faces)
    write_mesh("posed.ply", bent(V), F)
    words = line.replace("rest.ply rest.ply", "rest.ply posed.ply").split()
    taken = vars(PROGRAM.parser(words[0]).parse_args(words[1:]))
    own, place = taken.keys() & described().keys() - {"workers"}, words.index("-o") + 1
    output, words[place], written = words[place], "other.ply", {}
    for name in (None, *sorted(own)):
        assert main([*words, *(() if name is None else (f"--{name}", OTHER[name]))]) == 0
        written[name] = (here / "other.ply").read_bytes()
    assert own and [name for name in own if written[name] == written[None]] == [], output

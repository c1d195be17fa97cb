"""What a call of the command line costs beside its work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from eval.run.warmup import tiny_task
from eval.timing.timing import say, take_turns
from sshade.io.handles import write_handles
from sshade.io.meshes import write_mesh


def start_up(*, repeats: int) -> None:
    """Print the time of `sshade deform` on a mesh so small that imports and cached kernels are all there is.

    Parameters
    ----------
    repeats : int
        A first call, which may compile, is not counted.
    """
    task = tiny_task()
    with TemporaryDirectory() as folder:
        mesh, handles, out = (str(Path(folder, name)) for name in ("m.ply", "h.json", "o.ply"))
        write_mesh(mesh, task.mesh.V, task.mesh.F)
        write_handles(handles, task.handles)
        command = [sys.executable, "-m", "sshade", "deform", mesh, handles, "-o", out, "--samplings", "1"]

        def call() -> None:
            subprocess.run(command, check=True, capture_output=True)

        call()
        timing = take_turns({"call": call}, repeats)["call"]
    say(
        f"`sshade deform` on {task.mesh.n} vertices, warm cache: {timing.median:.2f} s, "
        "start-up for the most part"
    )

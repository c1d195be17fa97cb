"""Programs for the tests of external methods, and configurations of methods that run them."""

from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import psutil

#: Formats that a shell script can read and write.
TEXTS = {"mesh_format": "off", "handles_format": "txt", "output_format": "txt"}
#: Shell script that writes the positions of an OFF file unchanged.
COPYING = 'tail -n +3 "$1" | head -n "$(sed -n 2p "$1" | cut -d" " -f1)" > "$3"\n'


def wait_for(condition: Callable[[], bool], seconds: float = 60) -> None:
    end = monotonic() + seconds
    while not condition():
        assert monotonic() < end, "waited in vain"
        sleep(0.05)


def ended(pids: Path) -> bool:
    """Return whether all processes that a file lists have ended. A process not yet collected has ended."""
    found = [int(pid) for pid in pids.read_text().split()]
    return not any(map(running, found))


def running(pid: int) -> bool:
    """Return whether a process runs. It may end at any moment."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def program(folder: Path, text: str = COPYING) -> dict[str, Any]:
    """Write a shell script; return the configuration of a method that runs it."""
    (folder / "program.sh").write_text(text)
    command = ["sh", str(folder / "program.sh")]
    return {"_target_": "baselines.external.external", "command": command, **TEXTS}

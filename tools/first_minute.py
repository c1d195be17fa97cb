"""Measure what a newcomer waits for: ``python tools/first_minute.py``.

The command builds the wheel, downloads the wheels that it needs, installs them in a fresh environment, and
deforms a mesh of 20,000 vertices twice. Then it does the other work that compiled kernels are for, and
counts how often numba compiles. It prints a table in Markdown, and ends with exit code 1 if anything was
compiled. Run it with the Python that the wheel is for.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

ROOT = Path(__file__).parents[1]


def main() -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--wheel", type=Path, help="wheel to install (default: built from this clone)")
    args = parser.parse_args()
    print(f"Python {sys.version.split()[0]}, {sys.platform}\n\n| | |\n| --- | ---: |")
    with TemporaryDirectory() as folder:
        return measure(Path(folder), args.wheel)


def measure(folder: Path, wheel: Path | None) -> int:
    """Print the table; return 1 if kernels were compiled in the fresh environment, 0 otherwise."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    if wheel is None:
        row(
            "building the wheel",
            f"{timed([*pip, 'wheel', '-q', '--no-deps', '-w', folder, ROOT], folder):.1f} s",
        )
        (wheel,) = folder.glob("*.whl")
    timed([*pip, "download", "-q", "-d", folder / "wheels", wheel.resolve()], folder)
    sizes = [path.stat().st_size for path in (folder / "wheels").iterdir()]
    row("wheels to download", f"{sum(sizes) / 1e6:.1f} MB in {len(sizes)} files")
    row("our wheel", f"{wheel.stat().st_size / 1e6:.1f} MB")
    timed([sys.executable, "-m", "venv", folder / "venv"], folder)
    python = folder / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python"
    install = [python, *pip[1:], "install", "-q", "--no-index", "--find-links", folder / "wheels", "sshade"]
    row("installing", f"{timed(install, folder):.1f} s")
    torus(folder / "torus.off", folder / "handles.json")
    deform = [python, "-m", "sshade", "deform", "torus.off", "handles.json", "-o", "posed.ply"]
    for which in ("first", "second"):
        row(f"the {which} `sshade deform` of 20,000 vertices", f"{timed(deform, folder):.1f} s")
    timed([python, ROOT / "tools" / "first_actions.py", "torus.off", "handles.json"], folder)
    compilations = json.loads((folder / "compilations.json").read_text())
    for name, number in compilations.items():
        row(f"compilations of {name}", str(number))
    return int(any(compilations.values()))


def row(name: str, value: str) -> None:
    """Print a row of the table."""
    print(f"| {name} | {value} |", flush=True)


def timed(command: Sequence[object], folder: Path) -> float:
    """Run a command in a folder without variables that would change it; return its time in seconds."""
    environment = {
        key: text for key, text in os.environ.items() if key not in ("PYTHONPATH", "SSHADE_KERNELS")
    }
    words = [str(word) for word in command]
    begin = perf_counter()
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    seconds = perf_counter() - begin
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
    return seconds


def torus(mesh: Path, handles: Path, rings: int = 200, around: int = 100) -> None:
    """Write a torus of 20,000 vertices, with one side fixed and the other one lifted and turned."""
    angles = [
        (2 * math.pi * i / rings, 2 * math.pi * j / around) for i in range(rings) for j in range(around)
    ]
    points = [
        ((2 + math.cos(b)) * math.cos(a), (2 + math.cos(b)) * math.sin(a), math.sin(b)) for a, b in angles
    ]
    corner = [[(i % rings) * around + j % around for j in range(around + 1)] for i in range(rings + 1)]
    faces = []
    for i in range(rings):
        for j in range(around):
            a, b, c, d = corner[i][j], corner[i + 1][j], corner[i + 1][j + 1], corner[i][j + 1]
            faces += [(a, b, c), (a, c, d)]
    rows = [f"{x} {y} {z}" for x, y, z in points] + [f"3 {a} {b} {c}" for a, b, c in faces]
    mesh.write_text("\n".join(["OFF", f"{len(points)} {len(faces)} 0", *rows, ""]))
    near, far = points[:around:5], points[rings // 2 * around : (rings // 2 + 1) * around : 5]
    lifted = [(x, y, z + 1) for x, y, z in far]
    groups = [
        {"landmark": "near", "kind": "static", "source": near, "target": near},
        {"landmark": "far", "kind": "dynamic", "source": far, "target": lifted},
    ]
    handles.write_text(json.dumps({"handles": groups}))


if __name__ == "__main__":
    sys.exit(main())

"""Build an extension for Blender: vertex groups become handles, and the mesh follows empties.

The .zip is for the platform and the Python of this command. It contains this package with its kernels, and
the wheels of numba, llvmlite and SciPy. Pip fetches them from the network in the versions that are installed
here. In Blender, choose Edit, Preferences, Get Extensions, Install from Disk.

Blender 5.0 runs Python 3.11, Blender 5.1 and newer run Python 3.13.

example:
  sshade blender -o sshade.zip
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import distribution, version
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

from sshade.cli.arguments import check_outputs
from sshade.core.console import progress_bar, say
from sshade.core.errors import InputError
from sshade.core.progress import Progress
from sshade.core.whole_files import replacing

#: The extension's own files.
ADDON = Path(__file__).parents[1] / "blender"
#: Range of Blender's versions, the upper one excluded, by the version of the Python that they run.
BLENDERS = {(3, 11): ("5.0.0", "5.1.0"), (3, 13): ("5.1.0", None)}
#: Packages that the extension imports and Blender lacks. Blender has NumPy.
BUNDLED = ("numba", "llvmlite", "scipy")
#: Blender's name of a system, and of a kind of processor.
SYSTEMS = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}
PROCESSORS = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}
#: Seconds that pip waits for the network, and how often it tries again.
NETWORK = ("--timeout", "15", "--retries", "1")

MANIFEST = """\
schema_version = "1.0.0"
id = "sshade"
version = "{version}"
name = "SShaDe"
tagline = "Deform large meshes by moving a few handles"
maintainer = "the sshade authors"
type = "add-on"
blender_version_min = "{minimum}"
{maximum}license = ["SPDX:GPL-3.0-or-later"]
platforms = ["{platform}"]
tags = ["Mesh", "Modeling"]
wheels = [
{wheels}]
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "extension to write (.zip)"
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="ZIP", help=text)
    parser.set_defaults(inputs=(), overwrite=False)


def command(options: argparse.Namespace) -> int:
    """Write the extension; return the exit code."""
    check_outputs(options, output=(".zip",))
    blender_versions()
    platform_name()
    with tempfile.TemporaryDirectory() as folder, progress_bar() as progress:
        wheels = [*fetched_wheels(Path(folder), progress), own_wheel(Path(folder))]
        with replacing(options.output) as temporary:
            write_extension(temporary, wheels)
    size = options.output.stat().st_size
    say(f"{options.output}: extension for {platform_name()}, {size / 1e6:.0f} MB, GPL-3.0-or-later")
    say("in Blender: Edit, Preferences, Get Extensions, Install from Disk")
    return 0


def blender_versions() -> tuple[str, str | None]:
    """Return the first Blender that runs this Python, and the first later Blender that does not, or None.

    Raises
    ------
    InputError
        When no Blender runs this Python.
    """
    try:
        return BLENDERS[sys.version_info[:2]]
    except KeyError:
        known = " or ".join(f"{major}.{minor}" for major, minor in BLENDERS)
        raise InputError(
            f"no Blender since 5.0 runs Python {sys.version_info.major}.{sys.version_info.minor}; install "
            f"sshade for Python {known}, and run its `sshade blender`"
        ) from None


def platform_name() -> str:
    """Return Blender's name of this platform, such as ``linux-x64``.

    Raises
    ------
    InputError
        When Blender does not run here.
    """
    system, processor = platform.system(), platform.machine().lower()
    if system not in SYSTEMS or processor not in PROCESSORS:
        raise InputError(f"there is no Blender for {system} on {processor}")
    return f"{SYSTEMS[system]}-{PROCESSORS[processor]}"


def write_extension(path: Path, wheels: Sequence[Path]) -> None:
    """Write an extension with the given wheels, which stay unmodified."""
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("blender_manifest.toml", manifest([wheel.name for wheel in wheels]))
        for file in sorted(ADDON.glob("*.py")):
            archive.write(file, file.name)
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}")


def manifest(wheels: Sequence[str]) -> str:
    """Return the manifest of an extension with wheels of the given names."""
    minimum, maximum = blender_versions()
    return MANIFEST.format(
        version=version("sshade"),
        minimum=minimum,
        maximum=f'blender_version_max = "{maximum}"\n' if maximum else "",
        platform=platform_name(),
        wheels="".join(f'  "./wheels/{name}",\n' for name in wheels),
    )


def own_wheel(folder: Path) -> Path:
    """Write a wheel of the files of this package into a folder, and return its path."""
    package, root = distribution("sshade"), Path(__file__).parents[1]
    info = f"sshade-{package.version}.dist-info"
    files = {
        path.relative_to(root.parent).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }
    for file in package.files or ():
        if file.name in ("LICENSE", "NOTICE") and file.parts[0] != root.name:
            files[f"{info}/licenses/{file.name}"] = file.read_binary()
    files[f"{info}/METADATA"] = str(package.metadata).encode()
    files[f"{info}/WHEEL"] = b"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    record = []
    path = folder / f"sshade-{package.version}-py3-none-any.whl"
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        for name, content in files.items():
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            record.append(f"{name},sha256={digest},{len(content)}\n")
            archive.writestr(name, content)
        archive.writestr(f"{info}/RECORD", f"{''.join(record)}{info}/RECORD,,\n")
    return path


def fetched_wheels(folder: Path, progress: Progress) -> list[Path]:
    """Fetch the wheels of :data:`BUNDLED` into a folder, in the versions that are installed here.

    Compiled kernels work with one version of numba only.

    Raises
    ------
    InputError
        When a wheel cannot be fetched.
    """
    wheels: list[Path] = []
    for number, name in enumerate(BUNDLED):
        requirement = f"{name}=={version(name)}"
        progress("fetching wheels", number, len(BUNDLED), requirement)
        place = folder / name
        _download(place, requirement)
        wheels += place.glob("*.whl")
    progress("fetching wheels", len(BUNDLED), len(BUNDLED))
    return wheels


def _download(place: Path, requirement: str) -> None:
    """Have pip fetch a wheel into a folder, and raise InputError with its last error if it fails."""
    pip = [sys.executable, "-m", "pip", "download", "--disable-pip-version-check", "-q"]
    options = ["--only-binary=:all:", "--no-deps", *NETWORK, "--dest", str(place), requirement]
    run = subprocess.run([*pip, *options], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if run.returncode == 0:
        return
    lines = [line.strip() for line in run.stderr.splitlines()]
    found = next((line for line in reversed(lines) if line.startswith("ERROR: ")), "ERROR: pip is missing")
    why = found.removeprefix("ERROR: ").rstrip(".")
    advice = "check the network, or let PIP_FIND_LINKS name a folder that has the wheel"
    raise InputError(f"pip could not fetch {requirement}: {why}; {advice}")

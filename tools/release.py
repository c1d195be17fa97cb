"""Build and check the files of a release in ``dist``: ``make release``. Nothing is uploaded.

The command writes the source archive, the wheel for this Python and platform, the extension for Blender, the
site and a dataset with its card, and checks each of them. It prints a table of files and checks, and writes
``SHA256SUMS``. It ends with exit code 1 and one sentence at the first file that fails its check. The folder
``dist`` is deleted first.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote, urlsplit
from zipfile import BadZipFile, ZipFile

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"


class Failed(Exception):
    """A file of the release that must not be published, in one sentence."""


def main() -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.release", description=__doc__)
    parser.add_argument("--site", type=Path, required=True, metavar="DIR", help="site of `make docs`")
    parser.add_argument("--data", type=Path, required=True, metavar="DIR", help="dataset of `defaust build`")
    args = parser.parse_args()
    shutil.rmtree(DIST, ignore_errors=True)
    DIST.mkdir()
    try:
        version = version_of(ROOT)
        checks = release_site(args.site, version) | release_data(args.data, version)
        checks |= release_packages() | release_extension(version)
    except Failed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    sums = [f"{hashlib.sha256((DIST / name).read_bytes()).hexdigest()}  {name}\n" for name in checks]
    (DIST / "SHA256SUMS").write_text("".join(sums), "utf-8")
    print(f"sshade {version} in {DIST}\n\n| file | MB | checked |\n| --- | ---: | --- |")
    for name, text in checks.items():
        print(f"| {name} | {(DIST / name).stat().st_size / 1e6:.1f} | {text} |")
    print("\n".join(["", *notes(ROOT), "Nothing was uploaded."]))
    return 0


def version_of(root: Path) -> str:
    """Return the version, which the project, the citation and the change log must share."""
    version = str(tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["version"])
    for name, pattern in {"CITATION.cff": r"^version: (\S+)$", "CHANGELOG.md": r"^## ([^,\s]+)"}.items():
        found = re.search(pattern, (root / name).read_text("utf-8"), re.MULTILINE)
        if found is None or found[1] != version:
            raise Failed(f"{name} has the version {found and found[1]}, and pyproject.toml has {version}")
    return version


def notes(root: Path) -> list[str]:
    """Return sentences about the state of the clone that a release should not have."""
    found = []
    if "not released" in (root / "CHANGELOG.md").read_text("utf-8"):
        found.append("note: CHANGELOG.md says that this version is not released; give it a date")
    if output(["git", "status", "--porcelain"], folder=root):
        found.append("note: the clone has changes that are not committed")
    if any("-linux_" in path.name for path in DIST.glob("*.whl")):
        found.append("note: PyPI refuses wheels with the tag linux; offer the wheel on another page")
    return found


def release_packages() -> dict[str, str]:
    """Build the source archive, and the wheel from it; check both."""
    output([sys.executable, "-m", "build", "-o", DIST, ROOT])
    packages = sorted((*DIST.glob("*.tar.gz"), *DIST.glob("*.whl")))
    output([sys.executable, "-m", "twine", "check", "--strict", *packages])
    (wheel,) = DIST.glob("*.whl")
    check_wheel(wheel)
    output([sys.executable, ROOT / "tools" / "first_minute.py", "--wheel", wheel])
    tried = "twine check; deforms a mesh in a fresh environment, and compiles no kernel there"
    return {
        path.name: tried if path == wheel else "twine check; the wheel is built from it" for path in packages
    }


def check_wheel(wheel: Path) -> None:
    """Raise Failed unless a wheel has kernels, configurations and the licence, and no other folder."""
    names = zip_names(wheel)
    for part in ("sshade/compiled/", "eval/conf/config.yaml", ".dist-info/licenses/LICENSE"):
        if not any(part in name for name in names):
            raise Failed(f"{wheel.name} has no {part}")
    packages = ("sshade/", "baselines/", "defaust/", "eval/", "sshade-")
    if others := [name for name in names if not name.startswith(packages)]:
        raise Failed(f"{wheel.name} has {others[0]}, which belongs to no package")


def release_extension(version: str) -> dict[str, str]:
    """Build the extension for Blender, and check it."""
    from sshade.cli.blender import platform_name

    path = (
        DIST / f"sshade-{version}-blender-{platform_name()}-py{sys.version_info[0]}{sys.version_info[1]}.zip"
    )
    output([sys.executable, "-m", "sshade", "blender", "-o", path])
    check_extension(path, version)
    return {path.name: "its manifest and wheels are complete; not tried in Blender"}


def check_extension(path: Path, version: str) -> None:
    """Raise Failed unless an extension has its version, and exactly the wheels that its manifest names."""
    names = zip_names(path)
    with ZipFile(path) as archive:
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        wheels = {name.removeprefix("./") for name in manifest["wheels"]}
        if wheels != {name for name in names if name.startswith("wheels/")}:
            raise Failed(f"{path.name} does not have the wheels that its manifest names")
        for name in wheels:
            with archive.open(name) as file:
                check_zip(file, f"{name} in {path.name}")
    if manifest["version"] != version or not any(f"/sshade-{version}-" in name for name in wheels):
        raise Failed(f"{path.name} is not of version {version}")
    if "__init__.py" not in names:
        raise Failed(f"{path.name} has no __init__.py")


def release_site(site: Path, version: str) -> dict[str, str]:
    """Check the links of the site, and pack it."""
    if not (site / "index.html").is_file():
        raise Failed(f"{site} has no index.html; `make docs` writes it")
    if broken := broken_links(site):
        raise Failed(f"{len(broken)} links of {site} lead nowhere, such as {broken[0]}")
    pages = len(list(site.rglob("*.html")))
    return {packed(site, f"sshade-{version}-site"): f"all links between its {pages} pages lead to files"}


def release_data(data: Path, version: str) -> dict[str, str]:
    """Verify a dataset, pack it, and copy its card."""
    output([sys.executable, "-m", "defaust", "verify", data])
    card = json.loads((data / "croissant.json").read_text("utf-8"))
    for file in card["distribution"]:
        if (
            "sha256" in file
            and hashlib.sha256((data / file["contentUrl"]).read_bytes()).hexdigest() != file["sha256"]
        ):
            raise Failed(f"croissant.json has another checksum of {file['contentUrl']}")
    shutil.copy(data / "croissant.json", DIST / "croissant.json")
    archive = packed(data, f"sshade-{version}-{data.name}")
    return {archive: "defaust verify", "croissant.json": f"its checksums are those of the files in {archive}"}


def packed(folder: Path, name: str) -> str:
    """Pack a folder as a .zip file in ``dist``; return the name of the file."""
    return Path(shutil.make_archive(str(DIST / name), "zip", folder)).name


def zip_names(path: Path) -> list[str]:
    """Return the names in a .zip file, whose content must be intact."""
    with path.open("rb") as file:
        return check_zip(file, path.name)


def check_zip(file: object, title: str) -> list[str]:
    """Return the names in an open .zip file; raise Failed if its content is damaged."""
    try:
        with ZipFile(file) as archive:  # type: ignore[call-overload]
            damaged = archive.testzip()
            if damaged is None:
                return list(archive.namelist())
    except BadZipFile:
        damaged = "its index"
    raise Failed(f"{title} is damaged at {damaged}")


class _Links(HTMLParser):
    """Links and sources of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in ("href", "src") and value]


def broken_links(site: Path) -> list[str]:
    """Return the links of a site to files that do not exist, each behind its page."""
    broken = []
    for page in sorted(site.rglob("*.html")):
        if page == site / "404.html":  # its links begin at the root of a server
            continue
        links = _Links()
        links.feed(page.read_text("utf-8"))
        for link in links.found:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or not parts.path:
                continue
            target = page.parent / unquote(parts.path)
            if not (target / "index.html" if target.is_dir() else target).exists():
                broken.append(f"{page.relative_to(site)}: {link}")
    return broken


def output(command: Sequence[object], *, folder: Path | None = None) -> str:
    """Run a command in a folder, by default an empty one; return its output, and raise Failed if it fails."""
    words = [str(Path(word).resolve()) if isinstance(word, Path) else str(word) for word in command]
    print("  " + " ".join(words), file=sys.stderr, flush=True)
    with TemporaryDirectory() as empty:
        run = subprocess.run(words, cwd=folder or empty, capture_output=True, text=True)
    if run.returncode:
        print(run.stdout, run.stderr, sep="", file=sys.stderr)
        raise Failed(f"`{' '.join(words)}` ended with exit code {run.returncode}")
    return run.stdout


if __name__ == "__main__":
    sys.exit(main())

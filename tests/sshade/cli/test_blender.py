"""The command that builds the Blender extension."""

import subprocess
import sys
from importlib.metadata import version

from sshade.cli import blender
from sshade.cli.main import main
from tests.sshade.blender.wheels import small_wheel

PIP = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index", "--disable-pip-version-check"]


def test_the_own_wheel_installs_the_package_alone(tmp_path):
    """pip checks the RECORD."""
    wheel = blender.own_wheel(tmp_path)
    subprocess.run([*PIP, "--target", tmp_path / "site", wheel], check=True)
    installed = {path.name for path in (tmp_path / "site").iterdir()}
    assert installed == {"sshade", f"sshade-{version('sshade')}.dist-info"}
    assert (tmp_path / "site/sshade/plotting/viewer.js").is_file()
    assert list((tmp_path / "site").rglob("LICENSE"))


def test_without_network_the_command_says_so_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setattr(blender, "own_wheel", small_wheel)
    assert main(["blender", "-o", str(tmp_path / "sshade.zip")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "pip could not fetch numba==" in error and "check the network" in error
    assert list(tmp_path.iterdir()) == []

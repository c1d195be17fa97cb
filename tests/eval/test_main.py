"""The command ``sshade-eval``: what it lists, what it refuses, and that it imports only what is asked for."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from eval.main import COMMANDS, call, main


def test_help_names_every_command_and_imports_none():
    """Start-up stays short: no numpy for a help text, no Hydra or pandas but for what needs them."""
    program = "import sys; from eval.main import main; main(['--help']); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    *text, modules = done.stdout.splitlines()
    assert {line.split()[0] for line in text if line.startswith("  ")} >= set(COMMANDS)
    assert not {"numpy", "pandas", "hydra", "matplotlib"} & set(modules.split())


def test_the_state_of_a_checkout_is_asked_for_without_a_lock(tmp_path):
    """A program that is killed while git writes its index leaves it locked."""
    file, index = tmp_path / "file", tmp_path / ".git/index"
    file.write_text("same")
    git = ["git", "-C", str(tmp_path)]
    for arguments in (["init", "-q"], ["add", "file"]):
        subprocess.run([*git, *arguments], check=True)
    before = index.read_bytes()
    os.utime(file, (1, 1))  # which the index would take note of
    subprocess.run([*git, "status", "--porcelain"], check=True, capture_output=True)
    assert index.read_bytes() == before
    subprocess.run(
        [*git, "status"], check=True, capture_output=True, env=os.environ | {"GIT_OPTIONAL_LOCKS": "1"}
    )
    assert index.read_bytes() != before


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "run"])
def test_each_command_tells_its_arguments_and_refuses_others_in_one_sentence(name, capsys):
    with pytest.raises(SystemExit) as left:
        call(name, ["--help"])
    assert left.value.code == 0 and f"usage: sshade-eval {name}" in capsys.readouterr().out
    assert main([name, "--nonsense"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ") and told.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"), [([], "a command is missing"), (["tabels"], "'tabels' is no command")]
)
def test_no_such_command(arguments, words, capsys):
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert words in told and "tables" in told and told.count("\n") == 1

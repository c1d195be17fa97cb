"""The command ``sshade-eval``: what it lists, what it refuses, and that it imports only what is asked for."""

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

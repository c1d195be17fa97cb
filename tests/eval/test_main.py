"""The command ``sshade-eval`` lists its sub-commands and refuses unknown names."""

import pytest

from eval.main import COMMANDS, call, main
from tests.robustness.case import assert_refused


def test_help_names_every_command(capsys):
    main(["--help"])
    text = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in text if line.startswith("  ")} >= set(COMMANDS)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "run"])
def test_each_command_tells_its_arguments_on_a_screen_and_refuses_others(name, here, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as left:
        call(name, ["--help"])
    text = capsys.readouterr().out
    assert left.value.code == 0 and f"usage: sshade-eval {name}" in text and text.count("\n") <= 40
    assert_refused("sshade-eval", [name, "--nonsense"], "--help")


@pytest.mark.parametrize(
    ("arguments", "words"), [(["tabels"], "'tabels' is no command"), (["tbles"], "did you mean 'tables'?")]
)
def test_no_such_command(arguments, words, here):
    assert_refused("sshade-eval", arguments, words, "tables")

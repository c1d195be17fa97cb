"""The command ``sshade-eval`` lists its sub-commands and refuses unknown names."""

import pytest

from eval.main import COMMANDS, main
from tests.robustness.case import assert_refused


def test_help_names_every_command(capsys):
    main(["--help"])
    text = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in text if line.startswith("  ")} >= set(COMMANDS)


WRONG = [(["tbles"], "did you"), (["tables", "--nonsense"], "--help")]


@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_no_such_command_or_option(arguments, words, here):
    assert_refused("sshade-eval", arguments, words, "tables")

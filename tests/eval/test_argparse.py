"""All parsers of arguments pass a check of Python 3.14: help texts can be expanded."""

import argparse

import pytest
from eval_program import run_eval

import eval.main
import eval.run.sweep
import sshade.cli.main
from defaust.cli import make_parser

unchecked = argparse._ActionsContainer.add_argument


def add_argument(self, *names, **facts):
    action = unchecked(self, *names, **facts)
    if action.help and hasattr(self, "_get_formatter"):
        self._get_formatter()._expand_help(action)
    return action


@pytest.fixture(autouse=True)
def check(monkeypatch):
    monkeypatch.setattr(argparse._ActionsContainer, "add_argument", add_argument)


def test_a_run_starts(tmp_path):
    """Hydra's parser does not pass: a help text in it is no string."""
    eval.run.sweep._flags()  # its parser was made before the check
    assert run_eval(tmp_path, "method=identity", "dataset=bumpy").returncode == 0
    assert "Overrides : settings KEY=VALUE" in run_eval(tmp_path, "--help").stdout


def test_parsers_of_the_other_commands():
    make_parser()
    for program in (sshade.cli.main.PROGRAM, eval.main.PROGRAM):
        for name in set(program.commands) - {"run"}:
            program.parser(name)

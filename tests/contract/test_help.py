"""The help of each command describes all its arguments."""

import argparse

import pytest

from defaust.cli import make_parser
from eval.main import PROGRAM as EVAL
from sshade.cli.main import PROGRAM as SSHADE


@pytest.mark.parametrize(
    "parser", [SSHADE.parser(), EVAL.parser(), make_parser()], ids=["sshade", "sshade-eval", "defaust"]
)
def test_help_describes_each_argument(parser):
    def undescribed(name, parser):
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for command, sub_parser in action.choices.items():
                    yield from undescribed(f"{name} {command}", sub_parser)
            elif not action.help or action.help.startswith("default"):
                yield f"{name} {action.dest}"

    assert list(undescribed(parser.prog, parser)) == []

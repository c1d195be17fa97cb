"""The help of each command describes all its arguments."""

import argparse
from importlib import import_module

import pytest

from defaust.cli import make_parser
from eval.main import COMMANDS as EVAL
from sshade.cli.main import COMMANDS as SSHADE


def of_command(name, module):
    parser = argparse.ArgumentParser(name)
    import_module(module).add_arguments(parser)
    return parser


PARSERS = [of_command(name, module) for name, (module, _) in {**SSHADE, **EVAL}.items() if name != "run"]


@pytest.mark.parametrize("parser", [*PARSERS, make_parser()], ids=lambda parser: parser.prog)
def test_help_describes_each_argument(parser):
    def undescribed(name, parser):
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for command, sub_parser in action.choices.items():
                    yield from undescribed(f"{name} {command}", sub_parser)
            elif not action.help or action.help.startswith("default"):
                yield f"{name} {action.dest}"

    assert list(undescribed(parser.prog, parser)) == []

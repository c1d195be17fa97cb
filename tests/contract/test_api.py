"""The public interface is as in the committed list ``tools/api.txt``."""

import argparse

import pytest

from tools import api


def test_the_public_interface_is_as_listed():
    changes = api.changed_lines()
    if changes:
        advice = "If the change is meant, add it to CHANGELOG.md and run: python -m tools.api --update"
        pytest.fail(
            "\n".join(["The public interface differs from tools/api.txt.", *changes, advice]), pytrace=False
        )


@pytest.mark.parametrize(
    "parser",
    [api.SSHADE.parser(), api.EVAL.parser(), api.make_parser()],
    ids=["sshade", "sshade-eval", "defaust"],
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


def test_the_command_prints_changes_and_updates_the_list(tmp_path, monkeypatch, capsys):
    place = tmp_path / "api.txt"
    place.write_text(
        api.LIST.read_text("utf-8").replace("sshade.Mesh.volume\n", "sshade.Mesh.content\n"), "utf-8"
    )
    monkeypatch.setattr(api, "LIST", place)
    changes = "-sshade.Mesh.content\n+sshade.Mesh.volume\n"
    for arguments, code in ([], 1), (["--update"], 0):
        monkeypatch.setattr("sys.argv", ["api", *arguments])
        assert (api.main(), capsys.readouterr().out) == (code, changes)
    monkeypatch.setattr("sys.argv", ["api"])
    assert (api.main(), capsys.readouterr().out) == (0, "api.txt agrees with the code\n")

"""The public interface is as in the committed list ``tools/api.txt``."""

import argparse
from dataclasses import replace

import pytest

import sshade
from sshade.options import PRESETS
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


def test_changes_of_names_signatures_defaults_and_flags_are_named(monkeypatch):
    def read(place, *, merge=False):
        """Stand in for sshade.read."""

    def add_arguments(parser):
        declare(parser)
        parser.add_argument("--fast", action="store_true")

    import sshade.cli.remesh

    declare = sshade.cli.remesh.add_arguments
    monkeypatch.setattr(sshade, "__all__", [name for name in sshade.__all__ if name != "save_binding"])
    monkeypatch.setitem(vars(sshade), "read", read)
    monkeypatch.setitem(PRESETS, "fast", replace(PRESETS["fast"], vertices=9000))
    monkeypatch.setattr(sshade.cli.remesh, "add_arguments", add_arguments)
    assert api.changed_lines() == [
        "-sshade.read(path: str | os.PathLike[str])",
        "-sshade.read() -> Arrays",
        "+sshade.read(place: none given)",
        "+sshade.read(*, merge: none given = False)",
        "+sshade.read() -> none given",
        "-sshade.save_binding(path: str | os.PathLike[str])",
        "-sshade.save_binding(binding: Binding)",
        "-sshade.save_binding() -> None",
        "-method fast: vertices = 12000",
        "+method fast: vertices = 9000",
        "+sshade remesh --fast",
    ]


def test_fields_and_members_of_a_class_are_listed():
    lines = list(api.of_class("sshade.PosedPoints", sshade.PosedPoints))
    assert lines[0] == "sshade.PosedPoints: tuple"
    assert [line for line in lines if "maps" in line] == [
        "sshade.PosedPoints(maps: np.ndarray)",
        "sshade.PosedPoints.maps",
    ]
    assert "sshade.Mesh.require_manifold() -> None" in list(api.of_class("sshade.Mesh", sshade.Mesh))


def test_arguments_that_change_in_any_way_change_their_line():
    def line(**about):
        parser = argparse.ArgumentParser(add_help=False)
        parser.add_argument("--size", **about)
        (line,) = api.of_parser("tool", parser)
        return line

    kinds = [
        {},
        {"default": 3},
        {"required": True},
        {"nargs": 2},
        {"choices": [1, 2]},
        {"action": "store_true"},
    ]
    assert len({line(**about) for about in kinds}) == len(kinds)


def test_the_command_prints_changes_and_updates_the_list(tmp_path, monkeypatch, capsys):
    place = tmp_path / "api.txt"
    listed = api.LIST.read_text("utf-8")
    place.write_text(listed.replace("sshade.Mesh.volume\n", "sshade.Mesh.content\n"), "utf-8")
    monkeypatch.setattr(api, "LIST", place)
    changes = "-sshade.Mesh.content\n+sshade.Mesh.volume\n"
    for arguments, code in ([], 1), (["--update"], 0):
        monkeypatch.setattr("sys.argv", ["api", *arguments])
        assert (api.main(), capsys.readouterr().out) == (code, changes)
    monkeypatch.setattr("sys.argv", ["api"])
    assert (api.main(), capsys.readouterr().out) == (0, "api.txt agrees with the code\n")

"""Scripts that complete arguments in a shell: generated for every sub-command, and valid."""

import re
import shutil
import subprocess

import pytest

import defaust.cli
import eval.main
import sshade.cli.main

PROGRAMS = {
    "sshade": (sshade.cli.main.main, sshade.cli.main.PROGRAM.commands),
    "sshade-eval": (eval.main.main, eval.main.COMMANDS),
    "defaust": (defaust.cli.main, ("example", "build", "verify", "info")),
}


def script(capsys, program: str, shell: str) -> str:
    with pytest.raises(SystemExit) as caught:
        PROGRAMS[program][0](["--print-completion", shell])
    out, err = capsys.readouterr()
    assert caught.value.code == 0 and err == ""
    return out


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_sub_command_is_completed_in_every_shell(capsys, program):
    for shell in ("bash", "zsh", "tcsh"):
        text = script(capsys, program, shell)
        for command in PROGRAMS[program][1]:
            assert re.search(rf"\b{re.escape(command)}\b", text), (shell, command)


def completed(text: str, program: str, *words: str) -> list[str]:
    """Return the completions of the last word of a command line in bash."""
    line = " ".join(f"'{word}'" for word in (program, *words))
    ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words)}; _shtab_{program.replace('-', '_')}"
    done = subprocess.run(
        ["bash", "-c", f'{text}\n{ask}; printf "%s\\n" "${{COMPREPLY[@]}}"'], capture_output=True, text=True
    )
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_options_choices_and_files(capsys, here):
    (here / "body.ply").touch()
    text = script(capsys, "sshade", "bash")
    assert completed(text, "sshade", "trans") == ["transfer-pose"]
    assert completed(text, "sshade", "deform", "--refuse") == ["--refuse-unconstrained"]
    assert completed(text, "sshade", "deform", "--frames", "blended_") == ["blended_affine"]
    assert completed(text, "sshade", "deform", "bo") == ["body.ply"]
    for program in PROGRAMS:
        subprocess.run(["bash", "-n"], input=script(capsys, program, "bash"), text=True, check=True)


def test_an_unknown_shell_is_refused(capsys):
    for main, _ in PROGRAMS.values():
        assert main(["--print-completion", "cmd"]) == 2
        assert "choose from" in capsys.readouterr().err

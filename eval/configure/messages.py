"""Messages of Hydra in one sentence."""

from __future__ import annotations

import re


def one_sentence(complaint: str) -> str:
    """Shorten a message of Hydra to one sentence, without its search path and its hints for programmers."""
    text = re.sub(r"\s+", " ", complaint.split("Config search path")[0]).strip()
    choice = re.search(r"Could not find '(.+)/([^/']+)' Available options in '[^']*': (.+)", text)
    if choice:
        group, name, known = choice.groups()
        return f"there is no {group} {name!r}; choose one of {', '.join(known.split())}"
    setting = re.match(r"Could not override '([^']+)'\. To append", text)
    return f"there is no setting {setting[1]}" if setting else text


def unreadable_override(text: str, *, example: str) -> str:
    """Say in one sentence how to correct an argument ``key=value`` that Hydra cannot read."""
    if "=" not in text:
        return f"{text} is not understood; write settings as key=value"
    return (
        f"{text} is not understood; close its brackets, and put names with spaces or letters "
        f"outside of a-z in quotes twice, as in \"{example}='données'\""
    )

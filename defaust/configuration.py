"""The configuration of a build: read options ``key=value`` with Hydra.

In a clone, the YAML files are in ``conf/defaust``; a wheel holds a copy in ``defaust/conf``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException, OverrideParseException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from defaust.build.options import OPTIONS, BuildOptions
from defaust.schema import mismatch
from defaust.sources.source import Source
from sshade.core.errors import InputError, meant

_PACKAGE = Path(__file__).resolve().parent
_SHIPPED = _PACKAGE / "conf"

#: Folder of the YAML files of builds and sources.
CONFIGURATION = _SHIPPED if _SHIPPED.is_dir() else _PACKAGE.parent / "conf" / "defaust"

#: Examples for required options that are missing.
EXAMPLES = {"out": "out=data/defaust", "source.root": "source.root=MPI-FAUST"}


class BuildRequest(NamedTuple):
    """Arguments of :func:`defaust.build.dataset.build`."""

    source: Source
    out: Path
    options: BuildOptions
    workers: int | None
    strict: bool


def configure(overrides: Sequence[str]) -> BuildRequest:
    """Read the arguments of a build from overrides ``key=value``.

    Raises
    ------
    InputError
        On any mistake in the overrides, in one sentence.
    """
    for override in overrides:
        name, _, value = override.partition("=")
        if name == "source" and ("," in value or value.startswith("[")):
            raise InputError(
                f"{override} names several sources; choose one, and build each into its own folder"
            )
    try:
        with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
            config = compose("build", overrides=list(overrides))
        missing = OmegaConf.missing_keys(config)
        if missing:
            examples = [EXAMPLES.get(name, f"{name}=VALUE") for name in sorted(missing)]
            raise InputError(f"{', '.join(sorted(missing))} is not set; add e.g. {' '.join(examples)}")
        plain = cast("dict[str, Any]", OmegaConf.to_container(config, resolve=True))
        source = instantiate(config.source, _convert_="all")
    except OverrideParseException as error:
        raise InputError(unreadable_override(error.override, example="out")) from error
    except (HydraException, OmegaConfBaseException) as error:
        # instantiate wraps the error of a source in an error of its own.
        if isinstance(error.__cause__, InputError):
            raise error.__cause__ from error
        raise InputError(one_sentence(str(error))) from error
    if not isinstance(source, Source):
        target = plain["source"].get("_target_")
        raise InputError(f"source._target_={target} makes a {type(source).__name__}, and no source of shapes")
    if not isinstance(plain["out"], str):
        raise InputError(f"out={plain['out']} is no folder; give a name, such as ./2026 if it is a number")
    out = Path(os.path.expanduser(plain.pop("out")))
    workers, strict = plain.pop("workers"), plain.pop("strict")
    del plain["source"]
    unknown = sorted(set(plain) - set(OPTIONS))
    if unknown:
        hint = meant(unknown[0], OPTIONS) or "; see conf/defaust/build.yaml"
        raise InputError(f"there is no option {unknown[0]}{hint}")
    settings = {"workers": workers, "strict": strict}
    problem = mismatch(plain | settings, OPTIONS | {"workers": (int, None), "strict": bool})
    if problem:
        raise InputError(problem)
    return BuildRequest(source, out, BuildOptions(**plain), workers, strict)


def one_sentence(complaint: str) -> str:
    """Shorten a message of Hydra to one sentence, without its search path and its hints for programmers."""
    text = re.sub(r"\s+", " ", complaint.split("Config search path")[0]).strip()
    choice = re.search(r"Could not find '(.+)/([^/']+)' Available options in '[^']*': (.+)", text)
    if choice:
        group, name, known = choice.groups()
        return f"there is no {group} {name!r}; choose one of {', '.join(known.split())}"
    setting = re.match(r"Could not override '([^']+)'\. To append", text)
    return f"there is no setting {setting[1]}{meant(setting[1], OPTIONS)}" if setting else text


def unreadable_override(text: str, *, example: str) -> str:
    """Say in one sentence how to correct an argument ``key=value`` that Hydra cannot read."""
    if "=" not in text:
        return f"{text} is not understood; write settings as key=value"
    return (
        f"{text} is not understood; close its brackets, and put names with spaces or letters "
        f"outside of a-z in quotes twice, as in \"{example}='données'\""
    )

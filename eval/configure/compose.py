"""Configurations of methods and datasets outside of a sweep, by name and settings."""

from __future__ import annotations

import shlex
from itertools import product
from typing import Any, Literal, NamedTuple

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException, OverrideParseException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from eval.configure.messages import one_sentence, unreadable_override
from eval.configure.sweep import CASE
from eval.installation import CONFIGURATION
from sshade.core.errors import InputError


class Choice(NamedTuple):
    """A method or dataset of ``conf``, written as ``[LABEL=]NAME [KEY=VALUE ...]``.

    Attributes
    ----------
    label : str
        Name in tables; by default the name of the YAML file.
    name : str
        Name of a YAML file in ``conf/method`` or ``conf/dataset``.
    settings : tuple of str
        A key without a dot or an @ belongs to the method or dataset: ``samplings=1``. All other keys belong
        to the whole configuration: ``solver.start=rigid``.
    """

    label: str
    name: str
    settings: tuple[str, ...]


def read_choice(text: str) -> Choice:
    """Parse the text of a choice.

    Raises
    ------
    InputError
        When the name is missing, or a word after the name is not a setting.
    """
    first, *settings = shlex.split(text) or [""]
    label, _, name = first.rpartition("=")
    wrong = next((word for word in settings if "=" not in word), None)
    if not name or wrong is not None:
        found = repr(text) if wrong is None else f"{wrong!r} in {text!r}"
        raise InputError(f"{found} is not understood; write [LABEL=]NAME [KEY=VALUE ...]")
    return Choice(label or name, name, tuple(settings))


def resolved(group: Literal["method", "dataset"], choice: Choice) -> dict[str, Any]:
    """Return the configuration of a choice as plain values.

    Raises
    ------
    InputError
        On an unknown name or setting.
    """
    own = [word if {".", "@"} & set(word.split("=")[0]) else f"{group}.{word}" for word in choice.settings]
    try:
        with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
            config = compose("config", overrides=[f"{group}={choice.name}", *own])[group]
        missing = OmegaConf.missing_keys(config)
        if missing:
            raise InputError(f"{choice.name} needs {min(missing).removeprefix(f'{group}.')}=...")
        plain: dict[str, Any] = OmegaConf.to_container(config, resolve=True)
    except OverrideParseException as error:
        raise InputError(unreadable_override(error.override, example=f"{group}.root")) from error
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(one_sentence(str(error))) from error
    return plain


def one_each(choice: Choice) -> list[Choice]:
    """Return one choice for each case of a dataset with several subjects or poses, such as ``pose=1,2``."""
    values = []
    for word in choice.settings:
        key, _, value = word.partition("=")
        values.append([f"{key}={one}" for one in value.split(",")] if key in CASE else [word])
    return [choice._replace(settings=settings) for settings in product(*values)]

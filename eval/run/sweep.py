"""Read the arguments of `sshade-eval run` before Hydra does: flags, unknown keys, the runs of a sweep."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import OverrideParseException
from omegaconf import DictConfig, OmegaConf

from eval import CONFIGURATION
from eval.run.config import (
    CASE,
    check_root,
    composed,
    keys_of,
    label_of,
    nearest,
    plain_of,
    unreadable_override,
)
from eval.run.targets import locate
from sshade.core.console import CommandParser
from sshade.core.errors import InputError

#: Value that stands for all subjects or poses of a dataset.
ALL = "all"
#: Beginnings of the settings of Hydra that may be added, because plugins and the process read them.
OF_PLUGINS = ("hydra.launcher.", "hydra.sweeper.", "hydra.job.env_set.", "hydra.job_logging.")
#: Label of a method where none is given: the choice of the method.
CHOICE = "${hydra:runtime.choices.method}"


def _flags() -> CommandParser:
    """Return the parser of a command line, with the flags of Hydra that users of the evaluator need."""
    parser = CommandParser("sshade-eval run", add_help=False)
    parser.add_argument("overrides", nargs="*", help="settings KEY=VALUE and choices GROUP=NAME")
    parser.add_argument("-h", "--help", action="store_true", help="print this text")
    text = "do one run for each combination of values, such as seed=0,1"
    parser.add_argument("-m", "--multirun", action="store_true", help=text)
    text = "folder with further files, such as method/mine.yaml"
    parser.add_argument("-cd", "--config-dir", metavar="DIR", help=text)
    text = "print settings instead of running: job, hydra or all"
    parser.add_argument("-c", "--cfg", choices=("job", "hydra", "all"), help=text)
    # Hydra reads further flags, which have no use here.
    parser.set_defaults(run=False, shell_completion=False, config_path=None, config_name=None)
    parser.set_defaults(hydra_help=False, resolve=False, package=None, info=None)
    return parser


#: Parser of the command line of `sshade-eval run`.
FLAGS = _flags()


def prepared(arguments: Sequence[str]) -> Namespace:
    """Check a command line, and list the cases of a sweep in it; return the arguments for Hydra.

    A sweep over all subjects or poses becomes a sweep over the dataset's own. `run.of` is the number of runs.

    Raises
    ------
    InputError
        On an unknown flag, a key that nothing reads, a deleted setting that every run needs, a dataset that
        is missing, or a sweep that names a value twice, an unknown method, or two methods with one label.
    """
    known = FLAGS.parse_intermixed_args(list(arguments))
    if known.help:
        return known
    parser = _parser(known.config_dir)
    try:
        overrides = parser.parse_overrides(known.overrides)
    except OverrideParseException as error:
        raise InputError(unreadable_override(error.override)) from error
    overrides = [override for override in overrides if override.key_or_group != "hydra.mode"]
    several = {override.key_or_group for override in overrides if override.is_sweep_override()}
    # In a sweep over methods, the settings of a method are for the methods of the sweep, not for the default.
    plain = [o for o in overrides if not several & {o.key_or_group, o.key_or_group.split(".")[0]}]
    given = [_line(override) for override in plain if not override.is_add()]
    config = composed(given, folder=known.config_dir)
    _require_known(overrides, keys_of(config), folder=known.config_dir)
    if len(given) < len(plain):
        config = composed(map(_line, plain), folder=known.config_dir)
    if not known.multirun and str(config.hydra.mode) != "RunMode.MULTIRUN":
        if everything := [name for name in CASE if config[name] == ALL]:
            raise InputError(f"{everything[0]}={ALL} takes several runs; add -m")
        return known
    swept = _swept(config, overrides, parser)
    settings = [_as_sweep(override) for override in overrides if override.key_or_group not in (*CASE, "case")]
    settings += _label(config, overrides, swept, parser, folder=known.config_dir)
    cases = {name: values for name, values in swept.items() if name in CASE}
    if config.hydra.runtime.choices["hydra/launcher"] == "basic":
        # Hydra composes all runs of a batch before it begins the first: minutes for hundreds of runs.
        settings.append("hydra.sweeper.max_batch_size=1")
    runs = prod(len(values) for values in swept.values())
    settings += [f"{name}={','.join(values)}" for name, values in cases.items()]
    known.overrides = [*settings, f"run.of={runs}"]
    return known


def _line(override: Override) -> str:
    """Return a setting as it was written."""
    assert override.input_line is not None, "Hydra's parser keeps the text of each setting"
    return override.input_line


def _as_sweep(override: Override) -> str:
    """Write a setting of the method as a sweep over one value, which Hydra checks for the method of each run.

    Hydra checks all other settings for the default method, too.
    """
    is_plain = not (override.is_sweep_override() or override.is_delete())
    if not is_plain or not override.key_or_group.startswith("method."):
        return _line(override)
    # A choice takes no null, but each run reads the text 'null' as null.
    text = "'null'" if override.value() is None else override.get_value_element_as_str() or "''"
    return f"{override.get_key_element()}=choice({text})"


def _parser(folder: str | None) -> OverridesParser:
    """Return Hydra's parser of settings, which finds the names of a glob in conf and in a user's folder."""
    places = create_config_search_path(str(CONFIGURATION))
    if folder is not None:
        places.append("command-line", f"file://{Path(folder).absolute()}")
    return OverridesParser.create(config_loader=ConfigLoaderImpl(places))


def _swept(
    config: DictConfig, overrides: Iterable[Override], parser: OverridesParser
) -> dict[str, list[str]]:
    """Return the values of each setting of a sweep, from the experiment's file and the command line."""
    params: Mapping[str, Any] = config.hydra.sweeper.params or {}
    given = [*parser.parse_overrides([f"{name}={value}" for name, value in params.items()]), *overrides]
    swept = {
        override.get_key_element(): list(override.sweep_string_iterator())
        if override.is_sweep_override()
        else [override.get_value_element_as_str()]
        for override in given
        if not override.is_delete()
    }
    for name, values in swept.items():
        if twice := [value for value in values if values.count(value) > 1]:
            raise InputError(f"{name} names {twice[0]} twice; a sweep does each run once")
    asked = {name: swept.get(name, [str(config[name])]) for name in CASE}
    if any(ALL in values for values in asked.values()):
        if any(len(swept.get(name, [])) > 1 for name in ("dataset", "dataset.root", "dataset.cases")):
            raise InputError(f"{ALL} subjects or poses need a single dataset; sweep over one at a time")
        swept |= _listed(config.dataset, asked)
    return swept


def _label(
    config: DictConfig,
    overrides: Sequence[Override],
    swept: Mapping[str, list[str]],
    parser: OverridesParser,
    *,
    folder: str | None,
) -> list[str]:
    """Return the setting of the label of a sweep over settings of its methods, if none is given.

    The label then has the values that differ.

    Raises
    ------
    InputError
        When a method is unknown, or two methods have one label.
    """
    several = [name for name, values in swept.items() if len(values) > 1]
    choices = [name for name in several if name == "method" or name.startswith("method@")]
    values = [name for name in several if name.lstrip("+").startswith(("method.", "solver.", "proxy."))]
    differ = [name for name in [*choices, *values] if name != "method"]
    text = str(plain_of(config, resolve=False)["label"])
    given = [
        f"{name}={swept[name][0]}" if override.is_sweep_override() else _line(override)
        for override in overrides
        if (name := override.get_key_element()) not in several
    ]
    label = []
    if differ and text == CHOICE and "label" not in swept:
        label = [f"label='{CHOICE}-{_differing(differ)}'"]
    labels: dict[str, tuple[Any, str]] = {}
    for chosen in product(*(swept[name] for name in choices)):
        own = [f"{name}={value}" for name, value in zip(choices, chosen, strict=True)]
        composition = composed([*given, *own, *label], folder=folder)
        for combination in product(*(swept[name] for name in values)):
            words = [f"{name}={value}" for name, value in zip(values, combination, strict=True)]
            for override in parser.parse_overrides(words):
                OmegaConf.update(
                    composition, override.key_or_group, override.value(), force_add=override.is_add()
                )
            method = plain_of(composition.method)
            named = " ".join([*own, *words])
            first, name = labels.setdefault(label_of(composition), (method, named))
            if method != first:
                raise InputError(
                    f"{name} and {named} have the same label, {label_of(composition)!r}; leave label out, "
                    f"or write label='{CHOICE}{'-' * bool(differ)}{_differing(differ)}'"
                )
    return label


def _differing(names: Sequence[str]) -> str:
    """Return the part of a label with the values of settings, and with their names if there are several."""
    parts = []
    for name in names:
        key = name.lstrip("+")
        value = f'${{hydra:"runtime.choices[{key}]"}}' if "@" in key else f"${{{key}}}"
        parts.append(value if len(names) == 1 else f"{key.rpartition('.')[2]}={value}")
    return "-".join(parts)


def _listed(dataset: DictConfig, asked: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Return the subjects and poses that a dataset has, of those that a sweep asks for."""
    check_root(dataset)
    if "cases" not in dataset:  # a single case
        return {name: ["0"] if values == [ALL] else values for name, values in asked.items()}
    subjects, poses = (None if ALL in asked[name] else _numbers(name, asked[name]) for name in CASE)
    cases = locate(dataset.cases)(dataset.root, subjects=subjects, poses=poses)
    return {name: [str(n) for n in sorted({case[i] for case in cases})] for i, name in enumerate(CASE)}


def _numbers(name: str, values: list[str]) -> list[int]:
    if not all(value.isdigit() for value in values):
        raise InputError(f"{name}={','.join(values)} does not fit; it takes numbers from 0, or {ALL}")
    return [int(value) for value in values]


def lacks_case(dataset: Mapping[str, Any]) -> str:
    """Return why a dataset has no case with a configuration's subject and pose; empty if it has."""
    if "cases" not in dataset:
        return ""
    check_root(dataset)
    subject, pose = (dataset[name] for name in CASE)
    for name, value in zip(CASE, (subject, pose), strict=True):
        if not isinstance(value, int):
            _numbers(name, [str(value)])
    there = _cases(dataset["cases"], dataset["root"])
    if (subject, pose) in there:
        return ""
    poses = {p for s, p in there if s == subject}
    kind, own = ("poses", poses) if poses else ("subjects", {s for s, _ in there})
    listed = ", ".join(map(str, sorted(own)))
    return f"{dataset['root']} has no subject {subject}, pose {pose}; its {kind} are {listed}"


@cache
def _cases(function: str, root: str) -> set[tuple[int, int]]:
    """Return the cases of a dataset, which are listed once for all runs of a sweep."""
    return set(locate(function)(root))


def _require_known(overrides: Sequence[Override], known: set[str], *, folder: str | None) -> None:
    """Raise InputError on a key that nothing reads, or a deleted setting that every run needs."""
    groups = [override for override in overrides if _is_group(override, folder)]
    swept = {override.key_or_group for override in groups if override.is_sweep_override()}
    for override in (override for override in overrides if override not in groups):
        key = override.key_or_group
        root = key.split(".")[0]
        if override.is_delete() and (root in ("method", "dataset", "seed") or key.startswith("run.")):
            raise InputError(f"{override.input_line} deletes a setting that every run needs")
        if key == "method.version":
            raise InputError("method.version is set in the method's file, with the change of its results")
        read_later = root in swept  # for each method of the sweep
        read_later |= root == "hydra" and (not override.is_add() or key.startswith(OF_PLUGINS))  # by Hydra
        read_later |= override.is_add() and root in ("method", "dataset")  # by the function
        if not read_later and key not in known:
            raise InputError(f"there is no setting {key}{nearest(key, known)}")


def _is_group(override: Override, folder: str | None) -> bool:
    """Whether an override chooses a YAML file."""
    places = [CONFIGURATION, *([] if folder is None else [Path(folder)])]
    return override.package is not None or any((place / override.key_or_group).is_dir() for place in places)

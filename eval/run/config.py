"""Configurations of runs: composed by Hydra, checked, and as plain values."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from eval import CONFIGURATION
from eval.metrics import Task
from eval.rows.files import method_files
from eval.rows.store import TRUE_POSE, Row
from eval.run.environment import task_checksum
from eval.run.targets import check_parameters, instantiate, locate, parameter_hints
from sshade.core.errors import InputError, meant

#: Settings that identify a case of a dataset. A sweep also takes `all` in place of numbers.
CASE = ("subject", "pose")
#: Settings of a dataset that its loader does not take: the build command, the tag of the folder of its rows,
#: the function that lists its cases.
ABOUT_DATASET = ("build", "tag", "cases")


class RunSettings(NamedTuple):
    """How runs are done: the settings ``run.*``. See ``conf/config.yaml``."""

    experiment: str
    folder: str
    split: str | None
    force: bool
    fresh: bool
    time_limit: float | None
    of: int


class RunConfig(NamedTuple):
    """The configuration of a run as plain values.

    Attributes
    ----------
    label : str
        Name of the method in tables.
    method, dataset : mapping
    seed : int
    run : RunSettings
    runs : path
        Folder of the experiment's runs.
    """

    label: str
    method: Mapping[str, Any]
    dataset: Mapping[str, Any]
    seed: int
    run: RunSettings
    runs: Path

    @property
    def source(self) -> dict[str, Any]:
        """The part of the dataset's configuration that loads the task."""
        return source_of(self.dataset)


def source_of(dataset: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a dataset's configuration that loads the task."""
    return {name: value for name, value in dataset.items() if name not in ABOUT_DATASET}


def plain_of(config: DictConfig, *, resolve: bool = True) -> dict[str, Any]:
    """Return a configuration as plain values; `resolve` replaces references."""
    return cast("dict[str, Any]", OmegaConf.to_container(config, resolve=resolve))


def read_config(config: DictConfig) -> RunConfig:
    """Check the composed configuration of a run, and return it as plain values.

    Raises
    ------
    InputError
        When a setting is missing or unusable.
    """
    if missing := OmegaConf.missing_keys(config):
        raise InputError(f"{', '.join(sorted(missing))} is not set; give it as {min(missing)}=...")
    plain = plain_of(config)
    check_parameters(RunSettings, plain["run"], target="run")
    run, seed = RunSettings(**plain["run"]), plain["seed"]
    if type(seed) is not int:
        raise InputError(f"seed={seed} does not fit; it takes int")
    for name, value, smallest in (("seed", seed, 0), ("run.time_limit", run.time_limit, 1e-3)):
        if value is not None and value < smallest:
            raise InputError(f"{name}={value} does not fit; it takes at least {smallest:g}")
    experiment = Path(str(run.experiment))
    if experiment.is_absolute() or ".." in experiment.parts or not experiment.parts:
        raise InputError(f"run.experiment={experiment} is no name of a folder in {plain['paths']['runs']}")
    runs = Path(plain["paths"]["runs"], run.folder)
    return RunConfig(label_of(config), plain["method"], plain["dataset"], seed, run, runs)


def label_of(config: DictConfig) -> str:
    """Return the name of a composed configuration's method in tables.

    Raises
    ------
    InputError
        When the label is empty, a path, or another method's.
    """
    if config.label is None or config.label == "":
        raise InputError("label is empty; it is the name of the method in tables")
    # The choice of a method may be in a folder.
    choice = HydraConfig.get().runtime.choices["method"]
    label = str(config.label).replace(choice, choice.rpartition("/")[2])
    if "/" in label:
        raise InputError(f"label={label} has a '/'; it is a name in tables, and no path")
    require_own(label, choice)
    return label


def require_own(label: str, method: str) -> None:
    """Raise InputError if the label of a method is the name of another one, or of the true pose."""
    others = {name.rpartition("/")[2] for name in method_files()} - {method.rpartition("/")[2]}
    if label in {TRUE_POSE, *others}:
        raise InputError(f"the label {label!r} is taken; name {method} otherwise")


def check_root(dataset: Mapping[str, Any]) -> None:
    """Raise InputError, with the build command, when the folder of a dataset is missing."""
    root = dataset.get("root")
    if root is not None and not isinstance(root, str):
        raise InputError(f"dataset.root={root} is no folder; give a name, such as ./2026 if it is a number")
    if root is not None and not Path(root).exists():
        hint = f"; make it with: {dataset['build']}" if dataset.get("build") else ""
        raise InputError(f"the dataset folder {root} does not exist{hint}")


@lru_cache(maxsize=1)
def _loaded(source: str) -> Task:
    return task_of(json.loads(source), truth=False)


def load_case(config: RunConfig) -> Task:
    """Load the task of a run, without truth. The last task stays in memory, and no method gets it."""
    check_root(config.dataset)
    return _loaded(json.dumps(config.source))


def task_of(source: Mapping[str, Any], *, truth: bool) -> Task:
    """Call the function of a dataset's configuration; return its task.

    Parameters
    ----------
    source : mapping
    truth : bool
        Passed on to a function with this parameter. Other functions know no truth.

    Raises
    ------
    InputError
        When the dataset is missing, or the function returns no task, or a truth that nobody asked for.
    """
    asks = "_target_" in source and "truth" in parameter_hints(locate(source["_target_"]))
    task = instantiate({**source, "truth": truth} if asks else source)
    target = source["_target_"]
    if not isinstance(task, Task):
        raise InputError(f"{target} returns a {type(task).__name__}, and no task")
    if task.truth is not None and not truth:
        raise InputError(
            f"{target} gives the true pose before the method runs; let a parameter `truth` ask for it"
        )
    return task


def with_truth(task: Task, source: Mapping[str, Any]) -> Task:
    """Return a task of :func:`task_of` with its truth and the facts about the truth.

    The mesh stays the same object, because quantities of the rest shape are kept for it.
    """
    known = task_of(source, truth=True)
    return replace(task, truth=known.truth, meta=known.meta)


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
    config = composed([f"{group}={choice.name}", *own])[group]
    if missing := OmegaConf.missing_keys(config):
        raise InputError(f"{choice.name} needs {min(missing).removeprefix(f'{group}.')}=...")
    return plain_of(config)


def composed(overrides: Iterable[str], *, folder: str | None = None) -> DictConfig:
    """Compose a configuration outside of a run, Hydra's own part included.

    Raises
    ------
    InputError
        On an unknown name or setting, in one sentence.
    """
    overrides = list(overrides)
    if folder is not None:
        overrides.append(f"hydra.searchpath=[file://{folder}]")
    try:
        with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
            config = compose("config", overrides=overrides, return_hydra_config=True)
            HydraConfig.instance().set_config(config)  # the label may contain a choice of Hydra
            return config
    except OverrideParseException as error:
        raise InputError(unreadable_override(error.override)) from error
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(one_sentence(str(error))) from error


def one_each(choice: Choice) -> list[Choice]:
    """Return one choice for each case of a dataset with several subjects or poses, such as ``pose=1,2``."""
    values = []
    for word in choice.settings:
        key, _, value = word.partition("=")
        values.append([f"{key}={one}" for one in value.split(",")] if key in CASE else [word])
    return [choice._replace(settings=settings) for settings in product(*values)]


def nearest(key: str, known: Iterable[str]) -> str:
    """Return a hint to the known key that is most like a key; empty if none is."""
    parent, _, name = key.rpartition(".")
    beside = [other.rpartition(".")[2] for other in known if other.rpartition(".")[0] == parent]
    return meant(name, beside) if beside else meant(key, known)


def keys_of(config: DictConfig) -> set[str]:
    """Return all keys of a configuration, such as ``run`` and ``run.force``."""
    return set(_keys(plain_of(config, resolve=False)))


def _keys(config: Any, prefix: str = "") -> Iterable[str]:
    for name, value in config.items() if isinstance(config, dict) else ():
        yield f"{prefix}{name}"
        yield from _keys(value, f"{prefix}{name}.")


def load_task(row: Row) -> Task:
    """Load the task of a row from its dataset, with its truth.

    Raises
    ------
    InputError
        When the row does not name the source of its task, or the dataset is missing or has changed.
    """
    if not row.get("task.source"):
        raise InputError(f"the row of {row['task.name']} has no task.source to load its task; run it again")
    try:
        source = json.loads(row["task.source"])
    except (ValueError, RecursionError) as error:
        name = row["task.name"]
        raise InputError(f"the task.source of {name} is not JSON ({error}); run it again") from error
    task = task_of(source, truth=True)
    if task_checksum(task) != row["task.checksum"] or task.mesh.n != row["task.vertices"]:
        raise InputError(
            f"the dataset of {row['task.name']} has changed since the run; run it again, and remove this run"
        )
    return task


def one_sentence(complaint: str) -> str:
    """Shorten a message of Hydra to one sentence, without its search path and its hints for programmers."""
    text = re.sub(r"\s+", " ", complaint.split("Config search path")[0]).strip()
    choice = re.search(r"Could not find '(.+)/([^/']+)' Available options in '[^']*': (.+)", text)
    if choice:
        group, name, listed = choice.groups()
        known = listed.split()
        paths = [path.relative_to(CONFIGURATION / group) for path in (CONFIGURATION / group).rglob("*.yaml")]
        near = [path.with_suffix("").as_posix() for path in paths if path.stem == name]
        hint = meant(near[0], near) if near else meant(name, known)
        own = "; --config-dir names a folder with your own" if group == "method" else ""
        return f"there is no {group} {name!r}" + (hint or f"; choose one of {', '.join(known)}{own}")
    setting = re.match(r"Could not override '([^']+)'\. To append", text)
    if not setting:
        return text
    known = keys_of(composed([]))
    hint = "; not every method has it" if setting[1] in known else nearest(setting[1], known)
    return f"there is no setting {setting[1]}{hint}"


def unreadable_override(text: str) -> str:
    """Say in one sentence how to correct an argument ``key=value`` that Hydra cannot read."""
    if "=" not in text:
        return f"{text} is not understood; write settings as key=value"
    return (
        f"{text} is not understood; close its brackets, and put names with spaces or letters "
        f"outside of a-z in quotes twice, as in \"dataset.root='données'\""
    )

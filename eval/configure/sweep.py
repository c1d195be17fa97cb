"""Sweeps of ``sshade-eval run``: list the cases and runs, write the plan, show the progress."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.core.plugins import Plugins
from omegaconf import DictConfig, OmegaConf

from eval.rows.plan import write_plan
from eval.rows.store import Row
from eval.run.code import METRICS, code_version, loaded_code
from eval.run.monitor import Monitor
from eval.run.record import QUEUES, Sweep, SweepRecord, summary, unfinished
from eval.run.run import run
from eval.run.targets import check_parameters, code_of, locate
from sshade.core.console import say
from sshade.core.errors import InputError

#: Settings that identify a case of a dataset. A sweep also takes `all` in place of numbers.
CASE = ("subject", "pose")
ALL = "all"

#: Settings that have plain values in every configuration, and that no other setting depends on.
VALUES = ("case", *CASE, "seed")

#: Settings of a dataset that its loader does not take: the build command, the tag of the folder of its rows,
#: the function that lists its cases.
ABOUT_DATASET = ("build", "tag", "cases")

#: Display of the sweep that this process began; None in a launcher's worker.
monitor: Monitor | None = None


#: Class of Hydra's default sweeper. Hydra loads sweepers from its own packages only, so ours takes this name.
SWEEPER = "hydra._internal.core_plugins.basic_sweeper.BasicSweeper"
#: The class itself. Hydra's search for plugins executes its module again: an import may give an older class.
_Basic: Any = Plugins.instance().class_name_to_class[SWEEPER]


class PlannedSweeper(_Basic):
    """Hydra's sweeper with `all` subjects or poses, a plan, a record and a display.

    Runs that differ in :data:`VALUES` only are composed once, because that takes a tenth of a second.
    """

    def __init__(self, max_batch_size: int | None = None, params: Mapping[str, str] | None = None) -> None:
        # Hydra loads the module of its sweeper a second time, after which the constructor there fails.
        self.max_batch_size, self.params = max_batch_size, params or {}

    def sweep(self, arguments: list[str]) -> None:
        """List the runs, write their plan, and launch them with the folder of the record."""
        global monitor
        runs = self._runs(arguments)
        code, folders = _keep_plans(self._compose(runs))
        folder = Path(self.config.hydra.sweep.dir)
        for other in unfinished(folder):
            say(
                f"a sweep of {folder.name}, begun {other.begin.astimezone():%Y-%m-%d %H:%M} on {other.host}, "
                "has not ended: runs that are part of both sweeps may be done twice"
            )
        launcher = self.config.hydra.runtime.choices["hydra/launcher"]
        record = SweepRecord.create(folder, Sweep(datetime.now(UTC), runs, launcher, code=code))
        monitor = Monitor(record, folders, watch=launcher != "basic")
        place = QuotedString(str(record.folder), Quote.single).with_quotes()
        common = f"run.sweep={{record:{place},runs:{len(runs)}}}"
        texts = [[*_texts(run), common] for run in runs]
        for done in range(0, len(runs), size := self.max_batch_size or len(runs) or 1):
            for job in self.launcher.launch(texts[done : done + size], initial_job_idx=done):
                _ = job.return_value  # raises the error of a run in a worker

    def _runs(self, arguments: list[str]) -> list[dict[str, str]]:
        """Return the settings of each run.

        A dataset need not have every pose of every subject, so `all` subjects or poses become one sweep over
        `case`. A dataset without a list of cases has a single case.
        """
        # The loader resolves glob(*).
        parser = OverridesParser.create(self.hydra_context.config_loader)
        swept = {
            override.get_key_element(): list(override.sweep_string_iterator())
            if override.is_sweep_override()
            else [override.get_value_element_as_str()]
            for override in parser.parse_overrides([*_texts(self.params), *arguments])
        }
        asked = {name: swept.get(name, [str(self.config[name])]) for name in CASE}
        if any(ALL in values for values in asked.values()):
            if any(name.split(".")[0] == "dataset" and len(values) > 1 for name, values in swept.items()):
                raise InputError(f"{ALL} subjects or poses need a single dataset; sweep over one at a time")
            swept = self._listed(asked) | {name: v for name, v in swept.items() if name not in CASE}
        return [dict(zip(swept, values, strict=True)) for values in itertools.product(*swept.values())]

    def _listed(self, asked: Mapping[str, list[str]]) -> dict[str, list[str]]:
        """Return the values of `case` for the subjects and poses that a sweep asks for."""
        dataset = self.config.dataset
        check_root(dataset)
        if "cases" not in dataset:
            return {}
        numbers = {f"{name}s": _numbers(name, values) for name, values in asked.items()}
        cases = locate(dataset.cases)(dataset.root, **numbers)
        return {"case": [f"{{subject:{subject},pose:{pose}}}" for subject, pose in cases]}

    def _compose(self, runs: Iterable[dict[str, str]]) -> Iterator[dict[str, Any]]:
        """Yield the configuration of each run."""
        hydra, parser = HydraConfig.instance(), OverridesParser.create()
        loader = self.hydra_context.config_loader
        composed: dict[tuple[str, ...], tuple[DictConfig, DictConfig]] = {}
        for settings in runs:
            values = {name: settings[name] for name in VALUES if name in settings}
            others = tuple(_texts({name: value for name, value in settings.items() if name not in values}))
            if others not in composed:
                whole = loader.load_sweep_config(self.config, _texts(settings))
                hydra.set_config(whole)  # the label may contain a choice of Hydra
                parts = [name for name in whole if name != "hydra"]
                composed[others] = OmegaConf.masked_copy(whole, parts), hydra.cfg
            config, hydra.cfg = composed[others]
            for text in _texts(values):
                override = parser.parse_override(text)
                OmegaConf.update(config, override.key_or_group, override.value())
            yield plain_config(config)


def _texts(settings: Mapping[str, str]) -> list[str]:
    return [f"{name}={value}" for name, value in settings.items()]


def plain_config(config: DictConfig) -> dict[str, Any]:
    """Return the composed configuration of a run, without Hydra's part, as plain values.

    Raises
    ------
    InputError
        When a setting is missing or unusable.
    """
    missing = OmegaConf.missing_keys(config)
    if missing:
        raise InputError(f"{', '.join(sorted(missing))} is not set; give it as {min(missing)}=...")
    plain = OmegaConf.to_container(config, resolve=True)
    check_settings(plain)
    if plain["label"] is None or not label_of(plain):
        raise InputError("label is empty; it is the name of the method in tables")
    given: Any = OmegaConf.to_container(config, resolve=False)
    # The default label is the choice of a method, which may be in a folder.
    if "/" in str(plain["label"]) and "hydra:" not in str(given["label"]):
        raise InputError(f"label={plain['label']} has a '/'; it is a name in tables, and no path")
    try:
        json.dumps([plain[part] for part in ("label", "method", "dataset")], ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        raise InputError(
            "the label, the method or the dataset has a name that is not UTF-8, which no table can hold; "
            "rename it, or set PYTHONUTF8=1"
        ) from error
    return plain


def check_settings(config: dict[str, Any]) -> None:
    """Raise InputError on a seed or a setting ``run.*`` with a value that no run can use."""
    experiment = Path(str(config["run"]["experiment"]))
    if experiment.is_absolute() or ".." in experiment.parts or not experiment.parts:
        raise InputError(f"run.experiment={experiment} is no name of a folder in {config['paths']['runs']}")
    settings = {name: config["run"][name] for name in ("force", "fresh", "time_limit", "jobs")}
    settings |= {"seed": config["seed"], "jobs": 1 if settings["jobs"] is None else settings["jobs"]}
    check_parameters(run, settings, target="run")
    for name, value in settings.items():
        least = {"seed": 0, "jobs": 1, "time_limit": 1e-3}.get(name)
        if least is not None and value is not None and value < least:
            label = name if name == "seed" else f"run.{name}"
            raise InputError(f"{label}={value} does not fit; it takes at least {least:g}")


def label_of(plain: dict[str, Any]) -> str:
    """Return the name of the method in rows, without the subgroup of its YAML file."""
    return str(plain["label"]).rpartition("/")[2]


def source_of(dataset: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a dataset's configuration that loads the task."""
    return {name: value for name, value in dataset.items() if name not in ABOUT_DATASET}


def runs_folder(plain: dict[str, Any]) -> Path:
    """Return the folder of the experiment's runs."""
    return Path(plain["paths"]["runs"], plain["run"]["folder"])


def _keep_plans(configs: Iterable[dict[str, Any]]) -> tuple[dict[str, str], list[Path]]:
    """Check that all cases exist and write the plan of each experiment.

    Returns
    -------
    code : dict
        Hashes of the code.
    folders : list of path
        Of the runs.

    Raises
    ------
    InputError
        When a dataset is missing or lacks a case.
    """
    plans: dict[Path, list[Row]] = {}
    functions: set[str] = set()
    cases_of = cache(lambda function, root: {(subject, pose) for subject, pose in locate(function)(root)})
    for plain in configs:
        dataset = plain["dataset"]
        check_root(dataset)
        if "cases" in dataset:
            asked, there = tuple(dataset[name] for name in CASE), cases_of(dataset["cases"], dataset["root"])
            for name, value in zip(CASE, asked, strict=True):
                if not isinstance(value, int):
                    _numbers(name, [str(value)])
            if asked not in there:
                raise InputError(
                    f"the plan names subject {asked[0]}, pose {asked[1]}, which {dataset['root']} does not "
                    f"have; it has {len(there)} cases, and {ALL} takes them all"
                )
        source = source_of(dataset)
        functions_of_run = code_of(plain["method"]) | code_of(source)
        functions |= functions_of_run
        planned = {
            "method.name": label_of(plain),
            "seed": plain["seed"],
            "task.source": json.dumps(source),
            "env.version.code": code_version(functions_of_run),
            "env.version.metrics": METRICS,
        }
        plans.setdefault(runs_folder(plain), []).append(planned)
    for folder, runs in plans.items():
        write_plan(folder, runs)
    return loaded_code(functions), list(plans)


def _numbers(name: str, values: list[str]) -> list[int] | None:
    """Return the numbers of a sweep, None for all."""
    if ALL in values:
        return None
    if not all(value.isdigit() for value in values):
        raise InputError(f"{name}={','.join(values)} does not fit; it takes numbers from 0, or {ALL}")
    return [int(value) for value in values]


def close_sweep(*, killed: bool = False) -> str:
    """End the display and the record of a running sweep; return its summary, "" without a sweep.

    The record of a killed sweep stays, as does the record of a sweep whose jobs are in a queue.
    """
    if monitor is None:
        return ""
    monitor.close()
    sweep, ended = monitor.sweep, monitor.record.ended()
    if len(ended) == len(sweep.runs):
        monitor.record.complete()
    elif sweep.launcher not in QUEUES and not killed:
        monitor.record.remove()
    return f"{summary(sweep, ended)}; in {', '.join(map(str, monitor.folders))}"


def in_queue() -> bool:
    """Whether the running sweep has jobs in a queue, which continue when this process ends."""
    return monitor is not None and monitor.sweep.launcher in QUEUES


def check_root(dataset: Mapping[str, Any]) -> None:
    """Raise InputError, with the build command, when the folder of a dataset is missing."""
    root = dataset.get("root")
    if root is not None and not isinstance(root, str):
        raise InputError(f"dataset.root={root} is no folder; give a name, such as ./2026 if it is a number")
    if root is not None and not Path(root).exists():
        hint = f"; make it with: {dataset['build']}" if dataset.get("build") else ""
        raise InputError(f"the dataset folder {root} does not exist{hint}")

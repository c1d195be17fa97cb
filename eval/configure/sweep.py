"""Sweeps of ``sshade-eval run``: list the cases and runs, write the plan, show the progress."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf, open_dict, read_write

from eval.rows.plan import write_plan
from eval.rows.store import Row
from eval.run.allowed import require_allowed
from eval.run.code import METRICS, code_version, loaded_code
from eval.run.monitor import Monitor
from eval.run.record import QUEUES, Sweep, SweepRecord, summary, unfinished
from eval.run.run import run
from eval.run.targets import check_parameters, locate, target_functions
from sshade.errors import InputError
from sshade.io.files import reason

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

#: Settings ``method.*`` from the command line of a sweep. Hydra would check them against the default method.
#: They are passed to the runs only, so Hydra checks them against the method of each run.
method_settings: list[str] = []


class SweepRefused(BaseException):
    """A sweep that cannot begin or continue; the argument is the reason.

    It does not derive from Exception, because Hydra turns exceptions of callbacks into warnings, and
    exceptions of runs into results.
    """


class SweepStart(Callback):
    """Starts the record of a sweep. Hydra calls it because ``conf/config.yaml`` names it."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """List the cases and runs, write the plan, and pass the folder of the record to each run."""
        global monitor
        try:
            _add_overrides(config, *method_settings)
            _write_out_cases(config)
            launcher = config.hydra.runtime.choices["hydra/launcher"]
            swept = _swept(config)
            runs = [dict(zip(swept, values, strict=True)) for values in itertools.product(*swept.values())]
            code = _keep_plans(_compose(config, runs))
            folder = Path(config.hydra.sweep.dir)
            beside = unfinished(folder)
            record = SweepRecord.create(folder, Sweep(datetime.now(UTC), runs, launcher, code=code))
        except OSError as error:  # of the record's folder
            raise SweepRefused(InputError(f"{error.filename}: {reason(error)}")) from error
        except Exception as error:
            raise SweepRefused(error) from error
        for other in beside:
            print(  # noqa: T201
                f"a sweep of {folder.name}, begun {other.begin.astimezone():%Y-%m-%d %H:%M} on {other.host}, "
                "has not ended: runs that are part of both sweeps may be done twice",
                file=sys.stderr,
            )
        place = str(record.folder).replace("\\", "\\\\").replace("'", "\\'")
        _add_overrides(config, f"run.sweep={{record:'{place}',runs:{len(runs)}}}")
        monitor = Monitor(record, watch=launcher != "basic")


def plain_config(config: DictConfig) -> dict[str, Any]:
    """Return the composed configuration of a run, without Hydra's part, as plain values.

    Raises
    ------
    InputError
        When a setting is missing, or a function is named that is not allowed.
    """
    missing = OmegaConf.missing_keys(config)
    if missing:
        raise InputError(f"{', '.join(sorted(missing))} is not set; give it as {min(missing)}=...")
    plain = OmegaConf.to_container(config, resolve=True)
    check_settings(plain)
    for part in ("method", "dataset"):
        require_allowed(plain[part], where=f"the configuration of the {part}")
    return plain


def check_settings(config: dict[str, Any]) -> None:
    """Raise InputError on a seed or a setting ``run.*`` with a value that no run can use."""
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


def _compose(config: DictConfig, runs: list[dict[str, str]]) -> Iterator[dict[str, Any]]:
    """Yield the configuration of each run of a sweep.

    Composing takes a tenth of a second. Runs that differ in :data:`VALUES` only share one composition.
    """
    loader, hydra = GlobalHydra.instance().config_loader(), HydraConfig.instance()
    parser, before = OverridesParser.create(), hydra.cfg
    composed: dict[tuple[str, ...], tuple[DictConfig, DictConfig, dict[str, Any]]] = {}
    for one in runs:
        others = tuple(f"{name}={value}" for name, value in one.items() if name not in VALUES)
        if others not in composed:
            whole = loader.load_sweep_config(config, [f"{name}={value}" for name, value in one.items()])
            hydra.set_config(whole)  # the label may contain a choice of Hydra
            own = OmegaConf.masked_copy(whole, [name for name in whole if name != "hydra"])
            composed[others] = own, hydra.cfg, plain_config(own)
        own, hydra.cfg, plain = composed[others]
        for name in VALUES:
            if name in one:
                OmegaConf.update(own, name, parser.parse_override(f"{name}={one[name]}").value())
        parts = {name: OmegaConf.to_container(own[name], resolve=True) for name in ("dataset", "run")}
        plain = plain | {"label": own.label, "seed": own.seed} | parts
        hydra.cfg = before
        check_settings(plain)
        yield plain


def _keep_plans(configs: Iterable[dict[str, Any]]) -> dict[str, str]:
    """Check that all cases exist and write the plan of each experiment; return the hashes of the code.

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
            if asked not in there:
                raise InputError(
                    f"the plan names subject {asked[0]}, pose {asked[1]}, which {dataset['root']} does not "
                    f"have; it has {len(there)} cases, and {ALL} takes them all"
                )
        source = source_of(dataset)
        functions_of_run = target_functions(plain["method"]) | target_functions(source)
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
    return loaded_code(functions)


def _overrides(config: DictConfig) -> list[str]:
    """Return the settings of the command line, unresolved: a label may refer to values of a single run."""
    return OmegaConf.to_container(config.hydra.overrides.task, resolve=False)


def _add_overrides(config: DictConfig, *overrides: str) -> None:
    """Add settings to every run of the sweep."""
    with read_write(config), open_dict(config):
        config.hydra.overrides.task = [*_overrides(config), *overrides]


def _swept(config: DictConfig) -> dict[str, list[str]]:
    """Return the values of each setting of a sweep, in the order of the sweeper."""
    params = [f"{name}={values}" for name, values in (config.hydra.sweeper.params or {}).items()]
    parser = OverridesParser.create(GlobalHydra.instance().config_loader())  # the loader resolves glob(*)
    return {
        override.get_key_element(): list(override.sweep_string_iterator())
        if override.is_sweep_override()
        else [override.get_value_element_as_str()]
        for override in parser.parse_overrides([*params, *_overrides(config)])
    }


def _write_out_cases(config: DictConfig) -> None:
    """Replace `all` subjects or poses of a sweep by the cases of the dataset.

    A dataset need not have every pose of every subject, so subject and pose become one sweep over `case`.
    A dataset without a list of cases has a single case.
    """
    swept = _swept(config)
    asked = {name: swept.get(name, [str(config[name])]) for name in CASE}
    if not any(ALL in values for values in asked.values()):
        return
    if any(name.split(".")[0] == "dataset" and len(values) > 1 for name, values in swept.items()):
        raise InputError(f"{ALL} subjects or poses need a single dataset; sweep over one at a time")
    check_root(config.dataset)
    with read_write(config), open_dict(config):
        params = {name: v for name, v in (config.hydra.sweeper.params or {}).items() if name not in CASE}
        if "cases" in config.dataset:
            require_allowed({"cases": config.dataset.cases}, where="the configuration of the dataset")
            cases = locate(config.dataset.cases)(
                config.dataset.root, **{f"{n}s": _numbers(n, asked[n]) for n in CASE}
            )
            params = {"case": ",".join(f"{{subject:{s},pose:{p}}}" for s, p in cases), **params}
        config.hydra.sweeper.params = params
        config.hydra.overrides.task = [
            text for text in _overrides(config) if text.split("=", 1)[0] not in CASE
        ]


def _numbers(name: str, values: list[str]) -> list[int] | None:
    """Return the numbers of a sweep, None for all."""
    if ALL in values:
        return None
    if not all(value.isdigit() for value in values):
        raise InputError(f"{name}={','.join(values)} does not fit; it takes numbers from 0, or {ALL}")
    return [int(value) for value in values]


def close_sweep() -> str:
    """End the display and the record of a running sweep; return its summary, "" without a sweep."""
    if monitor is None:
        return ""
    monitor.close()
    sweep, ended = monitor.sweep, monitor.record.ended()
    if len(ended) == len(sweep.runs):
        monitor.record.complete()
    elif sweep.launcher not in QUEUES:  # runs in a queue continue without this process
        monitor.record.remove()
    return summary(sweep, ended)


def in_queue() -> bool:
    """Whether the running sweep has jobs in a queue, which continue when this process ends."""
    return monitor is not None and monitor.sweep.launcher in QUEUES


def check_root(dataset: Mapping[str, Any]) -> None:
    """Raise InputError, with the build command, when the folder of a dataset is missing."""
    root = dataset.get("root")
    if root is not None and not Path(root).exists():
        hint = f"; make it with: {dataset['build']}" if dataset.get("build") else ""
        raise InputError(f"the dataset folder {root} does not exist{hint}")

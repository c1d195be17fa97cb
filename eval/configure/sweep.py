"""Sweeps of ``sshade-eval run``: which cases, how many runs, and the display while they run."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, open_dict, read_write

from eval.run.allowed import require_allowed
from eval.run.monitor import Monitor
from eval.run.record import Plan, SweepRecord, summary
from eval.run.targets import locate
from sshade.errors import InputError
from sshade.io.files import reason

#: What tells the cases of a dataset apart; a sweep takes `all` instead of numbers too.
CASE = ("subject", "pose")
ALL = "all"

#: Launchers whose runs go on when this process ends.
QUEUES = ("slurm", "submitit_slurm")


#: The sweep that this process began; None in a launcher's worker.
monitor: Monitor | None = None

#: Settings ``method.*`` of a sweep's command line. Hydra would hold them against the method that the sweep
#: starts from; given to the runs alone, they are held against the method that each run names.
method_settings: list[str] = []


class SweepRefused(BaseException):
    """A sweep that cannot begin; no Exception, because Hydra turns what a callback raises into warnings."""


class SweepStart(Callback):
    """Begins the record of a sweep; Hydra calls it from the configuration."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Write out `all`, list the runs as the basic sweeper does, and tell each run of the record."""
        global monitor
        _add_overrides(config, *method_settings)
        try:
            _write_out_cases(config)
            launcher = config.hydra.runtime.choices["hydra/launcher"]
            swept = _swept(config)
            runs = [dict(zip(swept, values, strict=True)) for values in itertools.product(*swept.values())]
            plan = Plan(datetime.now(UTC), runs, launcher)
            record = SweepRecord.create(Path(config.hydra.sweep.dir), plan)
        except InputError as error:
            raise SweepRefused(error) from error
        except OSError as error:  # of the record's folder
            raise SweepRefused(InputError(f"{error.filename}: {reason(error)}")) from error
        folder = str(record.folder).replace("\\", "\\\\").replace("'", "\\'")
        _add_overrides(config, f"run.sweep={{record:'{folder}',runs:{len(plan.runs)}}}")
        monitor = Monitor(record, watch=launcher != "basic")


def _add_overrides(config: DictConfig, *overrides: str) -> None:
    """Give every run of the sweep further settings."""
    with read_write(config), open_dict(config):
        config.hydra.overrides.task = [*config.hydra.overrides.task, *overrides]


def _swept(config: DictConfig) -> dict[str, list[str]]:
    """Each overridden setting of a sweep with its values, in the sweeper's order."""
    params = [f"{name}={values}" for name, values in (config.hydra.sweeper.params or {}).items()]
    parser = OverridesParser.create(GlobalHydra.instance().config_loader())  # the loader resolves glob(*)
    return {
        override.get_key_element(): list(override.sweep_string_iterator())
        if override.is_sweep_override()
        else [override.get_value_element_as_str()]
        for override in parser.parse_overrides([*params, *config.hydra.overrides.task])
    }


def _write_out_cases(config: DictConfig) -> None:
    """Where a sweep takes `all` subjects or poses, put the cases of the dataset into the configuration.

    A dataset need not have every pose of every subject, so the two become one
    sweep over `case`. One without a list of cases has a single case.
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
            text for text in config.hydra.overrides.task if text.split("=", 1)[0] not in CASE
        ]


def _numbers(name: str, values: list[str]) -> list[int] | None:
    """The numbers of a sweep, None for all."""
    if ALL in values:
        return None
    if not all(value.isdigit() for value in values):
        raise InputError(f"{name}={','.join(values)} does not fit; it takes numbers from 0, or {ALL}")
    return [int(value) for value in values]


def close_sweep() -> str:
    """End the display and the record of the sweep under way; its summary in one line, "" if there is none."""
    if monitor is None:
        return ""
    monitor.close()
    plan, ended = monitor.plan, monitor.record.ended()
    if len(ended) == len(plan.runs):
        monitor.record.complete()
    elif plan.launcher not in QUEUES:  # runs in a queue outlive this process
        monitor.record.remove()
    return summary(plan, ended)


def in_queue() -> bool:
    """Whether the sweep under way has jobs in a queue, which go on when this process ends."""
    return monitor is not None and monitor.plan.launcher in QUEUES


def check_root(dataset: Mapping[str, Any]) -> None:
    """Raise InputError, with how to build the dataset, where its folder is missing."""
    root = dataset.get("root")
    if root is not None and not Path(root).exists():
        hint = f"; make it with: {dataset['build']}" if dataset.get("build") else ""
        raise InputError(f"the dataset folder {root} does not exist{hint}")

"""``python -m eval``: the Hydra program that runs methods on tasks.

Exit codes: 0 if no run failed, 1 if one did or left its committed band, 2 for a
mistake in the configuration, told in one sentence.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, OverrideParseException
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict, read_write
from omegaconf.errors import OmegaConfBaseException

from eval.allowed import allow_from, check_folders, require_allowed, require_from_command_line
from eval.check import out_of_band
from eval.metrics import METRICS
from eval.run import Outcome, run
from eval.store import Row, read_row, run_folders
from eval.targets import instantiate, locate
from sshade.console import progress_bar
from sshade.errors import InputError
from sshade.files import reason
from sshade.task import DeformationTask, silent

#: What tells the cases of a dataset apart; a sweep takes `all` instead of numbers too.
CASE = ("subject", "pose")
ALL = "all"

#: Settings of a dataset that are not for its loader: how to build it, where rows go, what lists its cases.
ABOUT_DATASET = ("build", "tag", "cases")


class RunFailed(Exception):
    """A run failed or left its band; its row tells more."""


class SweepRefused(BaseException):
    """A sweep that cannot begin; no Exception, because Hydra turns what a callback raises into warnings."""


@dataclass
class Sweep:
    """What this process knows of the sweep under way."""

    folder: Path
    total: int
    begin: str
    done: int = 0
    failed: int = 0


_sweep: Sweep | None = None

#: Errors of the runs in this process; None in a launcher's worker, where they must be raised.
_errors: list[Exception] | None = None


class SweepStart(Callback):
    """Notes where a sweep writes and how many runs it has; Hydra calls it from the configuration."""

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Write out `all`, then count the runs as the basic sweeper does: the product of the swept values."""
        global _sweep
        try:
            _write_out_cases(config)
        except InputError as error:
            raise SweepRefused(error) from error
        total = 1
        for values in _swept(config).values():
            total *= len(values)
        begin = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        _sweep = Sweep(Path(config.hydra.sweep.dir), total, begin)


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
    _check_root(config.dataset)
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


def main() -> int:
    """Entry point; see the module."""
    global _errors, _sweep
    _errors, _sweep = [], None
    # Hydra would print a traceback and exit with 1 on its own: let errors come through instead.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        _check_trust(sys.argv[1:])
        _app()
    except SweepRefused as refused:
        _errors.append(refused.__cause__)
    except (RunFailed, InputError) as error:
        _errors.append(error)
    except (HydraException, OmegaConfBaseException) as error:
        _errors.append(InputError(_one_line(error)))
    except OSError as error:  # of Hydra, which makes folders
        _errors.append(InputError(f"{error.filename or 'the system'}: {reason(error)}"))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)  # noqa: T201
        return 130
    mistakes = [error for error in _errors if isinstance(error, InputError)]
    if mistakes:
        print(f"error: {mistakes[0]}", file=sys.stderr)  # noqa: T201
        return 2
    if _sweep is not None:
        print(_summary(_sweep))  # noqa: T201
    else:
        for error in _errors:
            print(f"failed: {error}", file=sys.stderr)  # noqa: T201
    return 1 if _errors else 0


def _check_trust(arguments: list[str]) -> None:
    """Raise InputError where a folder of configurations names functions that nobody allowed."""
    known, _ = get_args_parser().parse_known_args(arguments)
    allow_from(known.overrides)
    folders = [known.config_dir, known.config_path]
    if known.config_path is not None:  # Hydra takes it from the folder of this file
        folders.append(str(Path(__file__).parent / known.config_path))
    check_folders(folders, overrides=known.overrides)


@hydra.main(version_base="1.3", config_path="pkg://conf", config_name="config")
def _app(config: DictConfig) -> None:
    try:
        _job(config)
    except (RunFailed, InputError) as error:
        # What is raised in this process, Hydra announces with the job's overrides; once is enough.
        if _errors is None:
            raise
        _errors.append(error)


def _job(config: DictConfig) -> None:
    """One run of a composed configuration; raises RunFailed if its row is bad."""
    hydra_config = HydraConfig.get()
    single = hydra_config.mode == RunMode.RUN
    missing = OmegaConf.missing_keys(config)
    if missing:
        raise InputError(f"{', '.join(sorted(missing))} is not set; give it as {min(missing)}=...")
    plain = OmegaConf.to_container(config, resolve=True)
    _check(plain)
    require_from_command_line(plain["run"]["allow_targets"])
    for part in ("method", "dataset"):
        require_allowed(plain[part], where=f"the configuration of the {part}")
    task = _load_task(json.dumps(plain["dataset"]))
    with progress_bar() if single else nullcontext(silent) as progress:
        outcome = run(
            task,
            plain["method"],
            name=plain["label"].rpartition("/")[2],  # of a method in a subgroup, its own name
            root=Path(plain["paths"]["runs"], plain["run"]["folder"]),
            seed=plain["seed"],
            source=_source(plain["dataset"]),
            force=plain["run"]["force"],
            fresh=plain["run"]["fresh"],
            time_limit=plain["run"]["time_limit"],
            jobs=plain["run"]["jobs"] or (1 if single else _jobs(hydra_config.launcher)),
            progress=progress,
        )
    if single and outcome.failed and outcome.row["reason"].startswith("InputError: "):
        raise InputError(outcome.row["reason"].removeprefix("InputError: "))
    problems = out_of_band(outcome.row, plain["bands"]) if plain.get("bands") else []
    if outcome.failed:
        problems = [outcome.row["reason"]]
    print(_report(outcome) if single else _line(outcome, problems), flush=True)  # noqa: T201
    if problems:
        raise RunFailed("; ".join(problems))


def _check(config: dict[str, Any]) -> None:
    """Raise InputError on values of our own settings that no run could use."""
    seed, settings = config["seed"], config["run"]
    if type(seed) is not int or seed < 0:
        raise InputError(f"seed={seed!r} is no seed; it takes a whole number from 0")
    for name in ("force", "fresh"):
        if not isinstance(settings[name], bool):
            raise InputError(f"run.{name}={settings[name]!r} does not fit; it takes true or false")
    limit, jobs = settings["time_limit"], settings["jobs"]
    if limit is not None and (type(limit) not in (int, float) or limit <= 0):
        raise InputError(f"run.time_limit={limit!r} does not fit; it takes seconds, or null for none")
    if jobs is not None and (type(jobs) is not int or jobs < 1):
        raise InputError(f"run.jobs={jobs!r} does not fit; it takes a whole number from 1, or null")


@lru_cache(maxsize=1)
def _load_task(dataset: str) -> DeformationTask:
    """The task of a dataset's configuration (as JSON: it is the cache's key)."""
    config = json.loads(dataset)
    _check_root(config)
    return instantiate(_source(config))


def _check_root(dataset: Mapping[str, Any]) -> None:
    """Raise InputError, with how to build the dataset, where its folder is missing."""
    root = dataset.get("root")
    if root is not None and not Path(root).exists():
        hint = f"; make it with: {dataset['build']}" if dataset.get("build") else ""
        raise InputError(f"the dataset folder {root} does not exist{hint}")


def _source(dataset: dict[str, Any]) -> dict[str, Any]:
    """What loads the task: a dataset's configuration without what is about the dataset."""
    return {name: value for name, value in dataset.items() if name not in ABOUT_DATASET}


def _jobs(launcher: DictConfig) -> int:
    """Runs at once, from the settings that launchers have; -1 means every core."""
    jobs = launcher.get("n_jobs") or launcher.get("array_parallelism") or 1
    return jobs if jobs > 0 else os.cpu_count() or 1


def _report(outcome: Outcome) -> str:
    """A single run in a few lines."""
    row = outcome.row
    lines = [f"{row['method.name']} on {row['task.name']}: {_status(outcome)}"]
    for name, metric in METRICS.items():
        if f"metric.{name}" in row:
            value = row[f"metric.{name}"]
            lines.append(f"  {name:<20} {'n/a' if value is None else f'{value:.4g} {metric.unit}'}")
    return "\n".join([*lines, f"  {outcome.folder}"])


def _line(outcome: Outcome, problems: list[str]) -> str:
    """A sweep's run in one line, with the counts so far where the sweep runs in this process."""
    row = outcome.row
    text = f"{row['method.name']} {row['task.name']} seed {row['seed']}: {_status(outcome)}"
    if problems and not outcome.failed:
        text += f" - {'; '.join(problems)}"
    if _sweep is not None:
        _sweep.done += 1
        _sweep.failed += bool(problems)
        text += f" [{_sweep.done} done, {_sweep.failed} failed, {_sweep.total - _sweep.done} remaining]"
    return text


def _status(outcome: Outcome) -> str:
    row = outcome.row
    if row.get("seconds.total") is None:
        return f"{row['status']} ({row['reason']})"
    text = f"{row['status']}, {row['seconds.total']:.2f} s, {row['iterations']:g} iterations"
    return f"{text}, already there" if outcome.reused else text


def _summary(sweep: Sweep) -> str:
    """Counts over the rows that the sweep wrote, by whichever process."""
    rows: list[Row] = [row for folder in run_folders(sweep.folder) if (row := read_row(folder))]
    new = [row["status"] for row in rows if row["date"] >= sweep.begin]
    counts = ", ".join(f"{new.count(status)} {status}" for status in sorted(set(new)))
    return (
        f"{sweep.total} runs: {len(new)} new{f' ({counts})' if counts else ''}, {sweep.total - len(new)} kept"
    )


def _one_line(error: Exception) -> str:
    """Hydra's message in one sentence: without its search path and its hints for debugging."""
    if isinstance(error, OverrideParseException):
        return (
            f"{error.override} is not understood; close its brackets, and put names with spaces or letters "
            f"outside of a-z in quotes twice, as in \"dataset.root='données'\""
        )
    text = str(error).split("Config search path")[0]
    if isinstance(error.__cause__, OmegaConfBaseException):
        text += f" {error.__cause__}"
    text = re.sub(r"\s+", " ", re.sub(r"(full_key|object_type|reference_type)[:=].*", "", text))
    return text.strip()

"""``sshade-eval run``: the Hydra program that runs methods on tasks.

Exit codes: 0 if no run failed; 1 if a run failed or left its committed band; 2 after a mistake in the
configuration, which is reported in one sentence.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from traceback import walk_tb

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from eval.configure import sweep as cli_sweep
from eval.configure.messages import one_sentence, unreadable_override
from eval.configure.sweep import ALL, CASE, check_root, label_of, plain_config, runs_folder, source_of
from eval.installation import CONFIGURATION, PACKAGES
from eval.metrics import METRICS
from eval.rows.bands import out_of_band
from eval.rows.splits import require_split
from eval.run.attempt import WROTE
from eval.run.code import CodeChanged, require_unchanged
from eval.run.recall import task_of
from eval.run.record import SweepRecord, status_text
from eval.run.run import Outcome, run
from eval.run.targets import code_of
from sshade.core.console import Ended, how_to_install, progress_bar
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.core.threads import available_cpus
from sshade.problem.task import DeformationTask

#: Packages of launchers. Errors from these packages mean that a worker was lost.
LAUNCHERS = ("joblib", "submitit", "ray")


class RunFailed(Exception):
    """A run failed or left its band; its row has the details."""


class WorkerLost(Exception):
    """A launcher lost a worker; the run of the worker left no row."""


#: Errors of the runs in this process. None in a launcher's worker, which raises its errors instead.
_errors: list[Exception] | None = None


def main() -> int:
    """Run the program with the arguments in ``sys.argv``; return the exit code.

    Raises
    ------
    InputError
        On a mistake in the configuration.
    """
    global _errors
    _errors, cli_sweep.monitor = [], None
    # Without this variable, Hydra prints a traceback and exits with code 1.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    if sys.path[0] != str(PACKAGES):  # `python -m eval` in a clone, which may not be installed
        # Workers of launchers must not search the current folder first for the project's packages.
        os.environ["PYTHONSAFEPATH"] = "1"
    interrupted, ended = False, None
    try:
        sys.argv[1:] = _checked(sys.argv[1:])
        Plugins.instance().class_name_to_class[cli_sweep.SWEEPER] = cli_sweep.PlannedSweeper
        _app()
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(_one_line(error)) from error
    except RunFailed as error:
        _errors.append(error)
    except KeyboardInterrupt:
        interrupted = True
    except Ended as signal:
        ended = signal
    except Exception as error:
        if cli_sweep.monitor is not None and type(error).__module__.split(".")[0] in LAUNCHERS:
            _errors.append(WorkerLost(type(error).__name__))
        elif isinstance(error, ValueError) and _raised_in(error).split(".")[0] in ("hydra", *LAUNCHERS):
            raise InputError(_one_line(error)) from error  # such as flags that do not go together
        else:
            raise
    finally:
        summary = cli_sweep.close_sweep(killed=ended is not None)
    if ended is not None:
        if summary:
            print(f"{summary}\nended by a signal; the same command goes on from there", file=sys.stderr)  # noqa: T201
        raise ended
    return _exit(_errors, summary, interrupted=interrupted)


def _exit(errors: list[Exception], summary: str, *, interrupted: bool) -> int:
    """Print how the command ended; return its exit code."""
    mistakes = [error for error in errors if isinstance(error, InputError)]
    if mistakes and not interrupted:
        raise mistakes[0]
    if summary:
        print(summary)  # noqa: T201
    queue = "; queued jobs go on: `sshade-eval status` shows their progress, `scancel` ends them"
    rest = queue if cli_sweep.in_queue() else "; the same command goes on from there" if summary else ""
    if interrupted:
        print(f"interrupted{rest}", file=sys.stderr)  # noqa: T201
        return 130
    for error in errors:
        if isinstance(error, WorkerLost):
            print(f"failed: a worker was lost ({error}){rest}", file=sys.stderr)  # noqa: T201
        elif not summary:  # the monitor has already printed a line for each run of a sweep
            print(f"failed: {error}", file=sys.stderr)  # noqa: T201
    return 1 if errors else 0


def _checked(arguments: list[str]) -> list[str]:
    """Check a command line; return the arguments that Hydra reads, flags first.

    Hydra takes no flag after a setting.

    Raises
    ------
    InputError
        On a flag that replaces the configuration, or a deleted setting that every run needs.
    """
    known, _ = get_args_parser().parse_known_intermixed_args(arguments)
    for flag in ("config_path", "experimental_rerun"):
        if getattr(known, flag) is not None:
            name = f"--{flag.replace('_', '-')}"
            raise InputError(f"{name} is not for this program; --config-dir adds configurations of your own")
    keys = {text: text.lstrip("+~").partition("=")[0] for text in known.overrides}
    for text, key in keys.items():
        if text.startswith("~") and (key in ("method", "dataset", "seed") or key.startswith("run.")):
            raise InputError(f"{text} deletes a setting that every run needs")
    settings = known.overrides
    if known.multirun:
        settings = [_as_sweep(text) if keys[text].startswith("method.") else text for text in settings]
    return [*(text for text in arguments if text not in known.overrides), *settings]


def _as_sweep(setting: str) -> str:
    """Write a setting as a sweep over a single value, which Hydra checks for the method of each run.

    Hydra checks all other settings for the default method, too.
    """
    override = OverridesParser.create().parse_overrides([setting])[0]
    if override.is_sweep_override() or override.is_delete():
        return setting
    value = override.get_value_element_as_str() or "''"
    return f"{override.get_key_element()}=choice({value})"


@hydra.main(version_base="1.3", config_path=str(CONFIGURATION), config_name="config")
def _app(config: DictConfig) -> None:
    # Launchers pickle this function with copies of the globals that it uses; `_job` is the only one.
    _job(config)


def _job(config: DictConfig) -> None:
    """Run a composed configuration; collect its error, or raise the error in a launcher's worker."""
    if _errors and isinstance(_errors[-1], CodeChanged):
        return  # no further run of the sweep can use the code
    try:
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            _job_of_sweep(config)
        else:
            _single_job(config)
    except (RunFailed, InputError) as error:
        # Hydra would print an error that this process raises a second time, with all settings of the run.
        if _errors is None:
            raise
        _errors.append(error)


def _single_job(config: DictConfig) -> None:
    """Do a single run; raise RunFailed if it failed or left its band."""
    if several := [name for name in CASE if config[name] == ALL]:
        raise InputError(f"{several[0]}={ALL} takes several runs; add -m")
    with progress_bar() as progress:
        outcome, problems = _outcome(config, progress)
    if outcome.failed and outcome.row["reason"].startswith("InputError: "):
        raise InputError(outcome.row["reason"].removeprefix("InputError: "))
    print(_report(outcome), flush=True)  # noqa: T201
    if problems:
        raise RunFailed("; ".join(problems))


def _job_of_sweep(config: DictConfig) -> None:
    """Do one run of a sweep, in this process or a worker, and add its result to the record of the sweep."""
    settings, monitor = HydraConfig.get(), cli_sweep.monitor
    if _errors is None:
        os.chdir(settings.runtime.cwd)  # relative paths start at the folder in which the sweep began
    record = SweepRecord(config.run.sweep.record)
    # The record is missing if the sweep was abandoned while this run waited in a queue.
    begun_with = record.sweep().code if _errors is None and record.folder.exists() else None
    try:
        with monitor.run_progress() if monitor is not None else nullcontext(silent) as progress:
            outcome, problems = _outcome(config, progress, begun_with=begun_with)
        record.add(settings.job.num, row=outcome.row, found=outcome.found, problems=problems)
    except CodeChanged:
        raise  # this error ends the whole sweep
    except InputError as error:
        record.add(settings.job.num, row=None, problems=[str(error)])
        raise
    finally:
        if monitor is not None:
            monitor.update()
    if problems:
        raise RunFailed("; ".join(problems))


def _outcome(
    config: DictConfig, progress: Progress, *, begun_with: Mapping[str, str] | None = None
) -> tuple[Outcome, list[str]]:
    """Run a composed configuration; return its outcome and the reasons why it counts as failed.

    `begun_with` is the code of the process that began the sweep; a worker must have loaded the same code.
    """
    plain = plain_config(config)
    if begun_with is not None:
        require_unchanged(code_of(plain["method"]), begun_with=begun_with)
    progress("reading", 0, 1)
    task = _load_task(json.dumps(plain["dataset"]))
    progress("reading", 1, 1)
    if not plain["dataset"].get("tag"):  # a tagged dataset gets a separate table
        require_split(task.name, plain["run"]["split"])
    settings = HydraConfig.get()
    at_once = 1 if settings.mode == RunMode.RUN else _jobs(settings.launcher, config.run.sweep.runs)
    outcome = run(
        task,
        plain["method"],
        name=label_of(plain),
        root=runs_folder(plain),
        seed=plain["seed"],
        source=source_of(plain["dataset"]),
        force=plain["run"]["force"],
        fresh=plain["run"]["fresh"],
        time_limit=plain["run"]["time_limit"],
        jobs=plain["run"]["jobs"] or at_once,
        shared=Path(plain["paths"]["runs"], plain["run"]["shared"]) if plain["run"]["shared"] else None,
        progress=progress,
    )
    if outcome.row.get("reason") == WROTE:
        _load_task.cache_clear()
    if outcome.failed:
        return outcome, [outcome.row["reason"]]
    return outcome, out_of_band(outcome.row, plain["bands"]) if plain.get("bands") else []


@lru_cache(maxsize=1)
def _load_task(dataset: str) -> DeformationTask:
    """Load the task of a dataset's configuration, given as JSON text to be a key of the cache."""
    config = json.loads(dataset)
    check_root(config)
    return task_of(source_of(config))


def _jobs(launcher: DictConfig, runs: int) -> int:
    """Return how many runs of a sweep a launcher executes at once; all runs if it has no limit."""
    if "ray" in launcher:
        import ray  # this process is a worker of Ray

        return min(runs, int(ray.cluster_resources()["CPU"] // (launcher.ray.remote.get("num_cpus") or 1)))
    if launcher._target_.endswith(".BasicLauncher"):
        return 1
    jobs = launcher.get("n_jobs") or launcher.get("array_parallelism") or runs
    return min(runs, jobs if jobs > 0 else available_cpus())


def _report(outcome: Outcome) -> str:
    """Describe a single run in a few lines."""
    row = outcome.row
    lines = [f"{row['method.name']} on {row['task.name']}: {status_text(row, found=outcome.found)}"]
    for name, metric in METRICS.items():
        if f"metric.{name}" in row:
            value = row[f"metric.{name}"]
            lines.append(f"  {name:<20} {'n/a' if value is None else f'{value:.4g} {metric.unit}'}")
    return "\n".join([*lines, f"  {outcome.folder}"])


def _raised_in(error: Exception) -> str:
    """Return the name of the module that raised an error."""
    *_, (frame, _) = walk_tb(error.__traceback__)
    return frame.f_globals["__name__"]


def _one_line(error: Exception) -> str:
    """Return Hydra's message in one sentence, without its search path and its hints for debugging."""
    if isinstance(error, OverrideParseException):
        return unreadable_override(error.override, example="dataset.root")
    text = str(error)
    if isinstance(error.__cause__, OmegaConfBaseException):
        text = f"{text.split('Config search path')[0]} {error.__cause__}"
    plugin = re.search(r"hydra/launcher/(?:submitit_)?(joblib|slurm|ray)\b", text)
    hint = f" To use it, {how_to_install(plugin[1])}." if plugin else ""
    return one_sentence(re.sub(r"(full_key|object_type|reference_type)[:=].*", "", text)) + hint

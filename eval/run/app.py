"""``sshade-eval run``: the Hydra program that runs methods on tasks.

Exit codes: 0 if no run failed; 1 if a run failed; 2 after a mistake in the configuration, which is reported
in one sentence.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from datetime import timedelta
from time import perf_counter
from traceback import walk_tb

import yaml
from hydra import version
from hydra._internal.utils import _run_hydra
from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from eval import CONFIGURATION, PACKAGES
from eval.metrics import METRICS
from eval.run.config import RunConfig, one_sentence, read_config, unreadable_override
from eval.run.run import Outcome, run
from eval.run.sweep import FLAGS, lacks_case, prepared
from sshade.core.console import Ended, how_to_install, progress_bar
from sshade.core.errors import InputError
from sshade.core.threads import available_cpus

#: Packages of launchers. Errors from these packages mean that a worker was lost.
LAUNCHERS = ("joblib", "submitit", "ray")
AGAIN = "the same command goes on from there"


class RunFailed(Exception):
    """A run failed; its row has the details."""


#: Errors of the runs in this process. None in a launcher's worker, which raises its errors instead.
_errors: list[Exception] | None = None
#: Seconds of each new run in this process.
_took: list[float] = []
#: Why runs of the sweep in this process have no case.
_without_case: list[str] = []


def main(arguments: Sequence[str]) -> int:
    """Run the program; return the exit code.

    Raises
    ------
    InputError
        On a mistake in the configuration.
    """
    global _errors
    _errors = []
    _without_case.clear()
    # Without this variable, Hydra prints a traceback and exits with code 1.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    if sys.path[0] != str(PACKAGES):  # `python -m eval` in a clone, which may not be installed
        # Workers of launchers must not search the current folder first for the project's packages.
        os.environ["PYTHONSAFEPATH"] = "1"
    version.setbase("1.3")
    try:
        # `hydra.main` would make Hydra's own parser, which Python 3.14 refuses to build.
        flags = prepared(arguments)
        _run_hydra(flags, FLAGS, _job, config_path=str(CONFIGURATION), config_name="config")
    except (HydraException, OmegaConfBaseException, yaml.YAMLError) as error:
        raise InputError(_one_line(error)) from error
    except RunFailed as error:
        _errors.append(error)
    except (KeyboardInterrupt, Ended) as end:
        print(f"interrupted; {AGAIN}", file=sys.stderr)  # noqa: T201
        if isinstance(end, Ended):
            raise
        return 130
    except Exception as error:
        package = type(error).__module__.split(".")[0]
        if package in LAUNCHERS:
            print(f"failed: a worker was lost ({type(error).__name__}); {AGAIN}", file=sys.stderr)  # noqa: T201
            return 1
        if isinstance(error, ValueError) and _raised_in(error).split(".")[0] in ("hydra", *LAUNCHERS):
            raise InputError(_one_line(error)) from error  # such as flags that do not go together
        raise
    if mistakes := [error for error in _errors if isinstance(error, InputError)]:
        raise mistakes[0]
    return 1 if _errors else 0


def _job(config: DictConfig) -> None:
    """Do a run; collect its error, or raise the error in a launcher's worker."""
    settings = HydraConfig.get()
    os.chdir(settings.runtime.cwd)  # relative paths start at the folder in which the sweep began
    try:
        _run(read_config(config), settings)
    except (RunFailed, InputError) as error:
        # Hydra would print an error that this process raises a second time, with all settings of the run.
        if _errors is None:
            raise
        _errors.append(error)


def _run(config: RunConfig, settings: HydraConf) -> None:
    """Do a run, and print its measures, or a line if it is one of a sweep."""
    place = "" if settings.mode == RunMode.RUN else f"[{settings.job.num + 1}/{config.run.of}] "
    if reason := lacks_case(config.dataset):
        if not place:
            raise InputError(reason)
        print(f"{place}{config.label}: skipped, {reason}", flush=True)  # noqa: T201
        _without_case.append(reason)
        if _errors is not None and len(_without_case) == config.run.of:
            raise InputError(f"no run of the sweep has a case; {reason}")
        return
    begin = perf_counter()
    with progress_bar() as progress:
        outcome = run(config, jobs=_at_once(settings.launcher, config.run.of), progress=progress)
    row = outcome.row
    if not outcome.found:
        _took.append(perf_counter() - begin)
    if not place and outcome.failed and row["reason"].startswith("InputError: "):
        raise InputError(row["reason"].removeprefix("InputError: "))
    seed = f", seed {row['seed']}" if place and row["seed"] else ""
    text = f"{place}{row['method.name']} on {row['task.name']}{seed}: {_status(outcome)}"
    print(text + (_left(settings.job.num, config.run.of) if place else _measures(outcome)), flush=True)  # noqa: T201
    if outcome.failed:
        raise RunFailed(row["reason"])


def _measures(outcome: Outcome) -> str:
    """Return the measures of a run and its folder, one a line."""
    named = {name: metric for name, metric in METRICS.items() if f"metric.{name}" in outcome.row}
    lines = [""]
    for name, metric in named.items():
        value = outcome.row[f"metric.{name}"]
        lines.append(f"  {name:<20} {'n/a' if value is None else f'{value:.4g} {metric.unit}'}")
    return "\n".join([*lines, f"  {outcome.folder}"])


def _left(number: int, of: int) -> str:
    """Return the time that the rest of a sweep takes in this process; empty in a launcher's worker."""
    if _errors is None or not _took or number + 1 == of:
        return ""
    seconds = round(sum(_took) / len(_took) * (of - number - 1))
    return f" (about {timedelta(seconds=seconds)} left)"


def _status(outcome: Outcome) -> str:
    """Describe a finished run: status, reason or seconds and iterations."""
    row = outcome.row
    if row["status"] in ("failed", "timeout", "skipped"):
        return f"{row['status']} ({row['reason']})"
    text = f"{row['status']}, {row['seconds.total']:.2f} s, {row['iterations']:g} iterations"
    return f"{text}, already there" if outcome.found else text


def _at_once(launcher: DictConfig, runs: int) -> int:
    """Return how many runs of a sweep a launcher executes at once; all runs if it has no limit."""
    if "ray" in launcher:
        import ray  # this process is a worker of Ray

        return min(runs, int(ray.cluster_resources()["CPU"] // (launcher.ray.remote.get("num_cpus") or 1)))
    if launcher._target_.endswith(".BasicLauncher"):
        return 1
    jobs = launcher.get("n_jobs") or launcher.get("array_parallelism") or runs
    return min(runs, jobs if jobs > 0 else available_cpus())


def _raised_in(error: Exception) -> str:
    """Return the name of the module that raised an error."""
    *_, (frame, _) = walk_tb(error.__traceback__)
    return frame.f_globals["__name__"]


def _one_line(error: Exception) -> str:
    """Return Hydra's message in one sentence, without its search path and its hints for debugging."""
    if isinstance(error, OverrideParseException):
        return unreadable_override(error.override)
    text = str(error)
    if isinstance(error.__cause__, OmegaConfBaseException):
        text = f"{text.split('Config search path')[0]} {error.__cause__}"
    plugin = re.search(r"hydra/launcher/(?:submitit_)?(joblib|slurm|ray)\b", text)
    hint = f" To use it, {how_to_install(plugin[1])}." if plugin else ""
    return one_sentence(re.sub(r"(full_key|object_type|reference_type)[:=].*", "", text)) + hint

"""What is timed: methods of ``conf`` and the tasks of its datasets, chosen on the command line."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

from eval.configure.compose import Choice, one_each, read_choice, resolved
from eval.configure.sweep import check_root, source_of
from eval.metrics import Task
from eval.rows.store import Row
from eval.run.provenance import config_hash, library_versions, task_checksum
from eval.run.targets import flat, instantiate, require_kind, settings, target_modules
from eval.run.warmup import warm_up
from sshade.errors import InputError
from sshade.task import DeformationResult


@dataclass(frozen=True)
class TimedMethod:
    """A method with its parameters.

    Parameters
    ----------
    label : str
        Its name in rows.
    config : dict
        Its configuration, resolved.
    """

    label: str
    config: dict[str, Any]

    def with_parameters(self, **parameters: Any) -> TimedMethod:
        """The same method with other values of some parameters."""
        return TimedMethod(self.label, self.config | parameters)

    def on(self, task: Task) -> partial[DeformationResult]:
        """A call of the method, compiled by a run on a tiny task.

        Raises
        ------
        InputError
            When it takes no such task or parameters, or needs a library that is not installed.
        """
        try:
            call = instantiate({**self.config, "_partial_": True})
        except ImportError as error:
            raise InputError(f"{self.label} cannot be timed: {' '.join(str(error).split())}") from error
        require_kind(call, task, target=self.config["_target_"])
        shrunk = self.config.get("warm_up", {})
        if shrunk is not None:
            warm_up(call, dict(shrunk), key=repr(settings(self.config)), kind=type(task))
        return partial(call, task, seed=0)

    @property
    def facts(self) -> Row:
        """The columns ``method.*``, and the versions of the libraries that it uses."""
        plain = settings(self.config)
        facts = {"method.name": self.label, "method.hash": config_hash(plain)} | flat(plain, "method")
        versions = library_versions(target_modules(self.config))
        return facts | {f"env.version.{library}": version for library, version in versions.items()}


def read_methods(texts: Iterable[str]) -> list[TimedMethod]:
    """The methods that choices name.

    Raises
    ------
    InputError
        On a choice that cannot be, or a label that stands for two of them.
    """
    choices = [read_choice(text) for text in texts]
    labels = [choice.label for choice in choices]
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(f"two methods are named {label!r}; name one of them LABEL={label}")
    return [TimedMethod(choice.label, resolved("method", choice)) for choice in choices]


def read_cases(texts: Iterable[str]) -> list[dict[str, Any]]:
    """The configurations that load the tasks which choices name.

    Raises
    ------
    InputError
        On a choice that cannot be, or a dataset that is not there.
    """
    choices: list[Choice] = [one for text in texts for one in one_each(read_choice(text))]
    sources = []
    for choice in choices:
        config = resolved("dataset", choice)
        check_root(config)
        sources.append(source_of(config))
    return sources


def task_facts(task: Task) -> Row:
    """The columns ``task.*``."""
    return {
        "task.name": task.name,
        "task.checksum": task_checksum(task),
        "task.vertices": task.mesh.n,
        "task.faces": task.mesh.m,
    }

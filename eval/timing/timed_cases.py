"""The methods and cases to time, chosen on the command line by their names in ``conf``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import igl
import numpy as np

from eval.configure.compose import one_each, read_choice, resolved
from eval.configure.sweep import check_root, source_of
from eval.metrics import Task
from eval.run.attempt import reason_of
from eval.run.recall import task_of
from eval.run.targets import instantiate, require_kind, settings
from eval.run.warmup import warm_up
from sshade.core.console import Ended
from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationResult, DeformationTask, result_of

#: Largest number of subdivisions of a case.
DEEPEST = 5


class TimedMethod(NamedTuple):
    """A method and its parameters.

    Parameters
    ----------
    label : str
        Name of the method in rows.
    config : dict
        Resolved configuration.
    block : int, optional
        Number of iterations from which the time of all iterations is estimated.
    """

    label: str
    config: dict[str, Any]
    block: int | None = None

    def on(self, task: Task) -> Callable[[], DeformationResult]:
        """Compile the method by a run on a tiny task; return its call on the task.

        Raises
        ------
        InputError
            If the method does not accept the task or its parameters, needs a library that is not installed,
            or fails; the call raises it, too.
        """
        with self._failures(task):
            method = instantiate({**self.config, "_partial_": True})
            require_kind(method, task, target=self.config["_target_"])
            shrunk = self.config.get("warm_up", {})
            if shrunk is not None:
                warm_up(method, dict(shrunk), key=repr(settings(self.config)), kind=type(task))

        def call() -> DeformationResult:
            with self._failures(task):
                return result_of(task, method(task, seed=0))

        return call

    @contextmanager
    def _failures(self, task: Task) -> Iterator[None]:
        try:
            yield
        except (InputError, Ended):
            raise
        except (Exception, SystemExit) as error:  # a method may raise anything
            raise InputError(f"{self.label} cannot be timed on {task.name}: {reason_of(error)}") from error


class TimedCase(NamedTuple):
    """A task, or a midpoint subdivision of it.

    Attributes
    ----------
    source : dict
        Configuration that loads the task.
    level : int, optional
        Number of subdivisions; None for the task as it is.
    """

    source: dict[str, Any]
    level: int | None = None

    def load(self) -> Task:
        """Load the task and subdivide it. Subdivision keeps the vertices and the handles on them."""
        task = task_of(self.source)
        if self.level is None:
            return task
        V, F = igl.upsample(np.array(task.mesh.V), np.array(task.mesh.F), self.level)
        return DeformationTask(f"{task.name}, level {self.level}", Mesh(V, F), task.handles)


def read_methods(texts: Iterable[str], *, blocks: Mapping[str, int]) -> list[TimedMethod]:
    """Resolve the choices of methods.

    Parameters
    ----------
    texts : iterable of str
    blocks : mapping
        Block of each method that is extrapolated, by label.

    Raises
    ------
    InputError
        If a choice cannot be resolved, two methods have the same label, or none has the label of a block.
    """
    methods: dict[str, TimedMethod] = {}
    for choice in [read_choice(text) for text in texts]:
        label = choice.label
        if label in methods:
            raise InputError(f"two methods are named {label!r}; name one of them LABEL={label}")
        methods[label] = TimedMethod(label, resolved("method", choice), blocks.get(label))
    if unknown := [label for label in blocks if label not in methods]:
        raise InputError(f"--extrapolate names {unknown[0]}, which is none of the methods")
    return list(methods.values())


def read_cases(texts: Iterable[str], *, sizes: Sequence[int]) -> list[TimedCase]:
    """Resolve the choices of datasets to cases.

    Parameters
    ----------
    texts : iterable of str
    sizes : sequence of int
        Numbers of vertices. If there are any, the cases are replaced by their subdivisions with the nearest
        numbers of vertices.

    Raises
    ------
    InputError
        If a choice cannot be resolved, or the dataset is missing.
    """
    sources = []
    for choice in [one for text in texts for one in one_each(read_choice(text))]:
        config = resolved("dataset", choice)
        check_root(config)
        sources.append(source_of(config))
    if not sizes:
        return [TimedCase(source) for source in sources]
    bases = [task_of(source).mesh.n for source in sources]
    return [TimedCase(sources[base], level) for _, base, level in nearest(bases, sizes)]


def nearest(bases: Sequence[int], sizes: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return the subdivisions with the numbers of vertices nearest to `sizes`, each once.

    Parameters
    ----------
    bases : sequence of int
        Numbers of vertices of the meshes to subdivide.
    sizes : sequence of int

    Returns
    -------
    list of (vertices, index of the base, number of subdivisions)
    """
    subdivisions = [(4**level * n, i, level) for i, n in enumerate(bases) for level in range(DEEPEST + 1)]
    return sorted({min(subdivisions, key=lambda case: abs(np.log(case[0] / size))) for size in sizes})

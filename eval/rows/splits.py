"""The two halves of the benchmark: tuning cases to choose constants, held-out cases to report results.

No body and no pose is in both halves. The file ``conf/splits.yaml`` describes the halves by patterns of task
names. A case that shares its body or its pose with a tuning case is in neither half, and so are cases of a
reader's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache

from eval.rows.files import read_conf
from sshade.core.errors import InputError

#: Names of the halves.
TUNING, HELD_OUT = "tuning", "held_out"
#: Value of ``run.split`` for an experiment with cases of both halves.
BOTH = "both"


def split_of(task: str) -> str | None:
    """Return the half of a case: ``"tuning"``, ``"held_out"``, or None if neither half names it.

    Parameters
    ----------
    task : str
        Name of the task, such as ``defaust-new_bodies/subject_12/pose_3``.

    Raises
    ------
    InputError
        When both halves name the task.
    """
    splits = read_splits()
    halves = [half for half in (TUNING, HELD_OUT) if any(fnmatchcase(task, p) for p in splits[half])]
    if len(halves) > 1:
        raise InputError(f"conf/splits.yaml puts {task} into both halves; a case belongs to one")
    return halves[0] if halves else None


def require_split(task: str, split: str | None) -> None:
    """Check that a case belongs to the half of the benchmark that an experiment states.

    Parameters
    ----------
    task : str
        Name of the task.
    split : {"tuning", "held_out", "both"} or None
        Stated half. None and "both" accept every case, and a reader's own data are always accepted.

    Raises
    ------
    InputError
        When the case belongs to another half, or to neither half of a dataset with halves, or `split` is
        unknown.
    """
    if split not in (TUNING, HELD_OUT, BOTH, None):
        raise InputError(f"run.split={split} does not fit; it takes {TUNING}, {HELD_OUT}, {BOTH} or null")
    half, halves = split_of(task), read_splits()
    dataset = task.partition("/")[0]
    known = any(fnmatchcase(dataset, pattern.partition("/")[0]) for own in halves.values() for pattern in own)
    if known and split not in (half, BOTH, None):
        found = f"is a {half} case" if half else "is in neither half"
        raise InputError(
            f"{task} {found} (conf/splits.yaml), but the experiment states run.split={split}: "
            f"take other cases, or state {BOTH} and give the rows a name of their own, run.experiment=..."
        )


@cache
def read_splits() -> Mapping[str, Sequence[str]]:
    """Return the patterns of ``conf/splits.yaml`` by half."""
    return read_conf("splits")

"""Which half of the benchmark a case belongs to: constants are chosen on one, claims are made on the other.

The committed file ``conf/splits.yaml`` names both halves by patterns of task names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache

from sshade.cli.configuration import CONFIGURATION
from sshade.errors import InputError

#: The halves: cases that constants may be chosen on, and cases that no choice was made on.
TUNING, HELD_OUT = "tuning", "held_out"
#: What an experiment states that uses both.
BOTH = "both"


def split_of(task: str, splits: Mapping[str, Sequence[str]] | None = None) -> str | None:
    """``"tuning"``, ``"held_out"``, or None for a case that the splits do not name, such as a reader's own.

    Parameters
    ----------
    task : str
        Its name, such as ``defaust-synthetic/subject_05/pose_7``.
    splits : mapping, optional
        Patterns by half; those of ``conf/splits.yaml`` unless told.

    Raises
    ------
    InputError
        When both halves name the task.
    """
    splits = read_splits() if splits is None else splits
    halves = [half for half in (TUNING, HELD_OUT) if any(fnmatchcase(task, p) for p in splits[half])]
    if len(halves) > 1:
        raise InputError(f"conf/splits.yaml puts {task} into both halves; a case belongs to one")
    return halves[0] if halves else None


def require_split(task: str, split: str | None) -> None:
    """Hold a case against the half that an experiment states.

    Parameters
    ----------
    task : str
        Its name.
    split : {"tuning", "held_out", "both"} or None
        Cases that belong to neither half fit any; None and "both" take every case.

    Raises
    ------
    InputError
        When the case belongs to the other half, or there is no such half.
    """
    if split not in (TUNING, HELD_OUT, BOTH, None):
        raise InputError(f"run.split={split} does not fit; it takes {TUNING}, {HELD_OUT}, {BOTH} or null")
    half = split_of(task)
    if half is not None and split not in (half, BOTH, None):
        raise InputError(
            f"{task} is a {half} case (conf/splits.yaml), but the experiment states run.split={split}: "
            f"take other cases, or state {BOTH} and give the rows a name of their own, run.experiment=..."
        )


@cache
def read_splits() -> Mapping[str, Sequence[str]]:
    """The patterns of ``conf/splits.yaml`` by half."""
    import yaml

    return yaml.safe_load((CONFIGURATION / "splits.yaml").read_text())

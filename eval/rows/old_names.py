"""Names that methods and options had in earlier versions: the error about an old name gives the new one."""

from __future__ import annotations

from collections.abc import Iterable

from sshade.errors import InputError
from sshade.options import OLD_METHODS, OLD_NAMES

#: Old name of a method -> new name, in ``conf/method``.
METHODS = {**OLD_METHODS, "sshade_residual": "residual"}


def refuse_old_names(setting: str, values: Iterable[str] = ()) -> None:
    """Raise InputError, with the new name, on the old name of an option or of a method in ``conf/method``.

    Parameters
    ----------
    setting : str
        ``method``, ``method@method.coarse``, or an option such as ``method.volume``.
    values : iterable of str
        Names of methods, if the setting chooses methods.
    """
    path, _, option = setting.rpartition(".")
    if path.split(".")[0] == "method" and option in OLD_NAMES:
        new = f"{path}.{OLD_NAMES[option]}"
        raise InputError(f"the option {setting} is now named {new}; write {new} in place of {setting}")
    for name in values if setting.partition("@")[0] == "method" else ():
        group, slash, method = name.rpartition("/")
        if method in METHODS:
            new = f"{group}{slash}{METHODS[method]}"
            raise InputError(f"the method {name} is now named {new}; write {new} in place of {name}")

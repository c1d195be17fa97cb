"""The methods as functions of a task."""

from functools import partial

from sshade import deform

METHODS = {name: partial(deform, method=name) for name in ("fast", "fine", "paper")}
fast, fine, paper = METHODS.values()

from __future__ import annotations

import sys
from functools import partial
from types import ModuleType

from eval.warmup import tiny_task, tiny_transfer, warm_up
from sshade.apart import _lacks
from sshade.fine import prepare
from sshade.geodesic import _insert
from sshade.substitution import _rows
from sshade.task import DeformationTask
from sshade.transfer_task import TransferTask


def test_a_method_runs_once_and_what_its_module_prepares_too(monkeypatch):
    said = []

    def method(task, *, seed: int, size: int) -> None:
        said.append((task.name, size))

    module = ModuleType("prepared")
    module.prepare = lambda: said.append("prepared")
    monkeypatch.setitem(sys.modules, "prepared", module)
    method.__module__ = "prepared"
    for _ in range(2):
        warm_up(partial(method, size=3), {"size": 2}, key="a", kind=DeformationTask)
    assert said == [(tiny_task().name, 2), "prepared"]
    del module.prepare
    warm_up(method, {"size": 1}, key="b", kind=TransferTask)
    assert said[2:] == [(tiny_transfer().name, 1)]


def test_what_sshade_fine_prepares_is_compiled():
    prepare()
    assert all(kernel.signatures for kernel in (_lacks, _insert, _rows))

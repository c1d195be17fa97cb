"""Freed memory returns to the system."""

import ctypes
import sys

import numpy as np
import pytest

from eval.run.environment import process_memory
from sshade.solver.system import give_back


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "malloc_trim"),
    reason="only glibc keeps freed memory",
)
def test_memory_under_a_living_array_is_returned():
    arrays = [np.ones(12_000) for _ in range(1000)]  # small enough for the heap
    last = arrays.pop()
    arrays.clear()
    kept = process_memory("VmRSS")
    give_back()
    assert kept - process_memory("VmRSS") > 60e6
    assert last.all()

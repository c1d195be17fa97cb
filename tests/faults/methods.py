"""Methods that take their process to its limits; for runs in a process of their own."""

import os
import resource
import signal

import numpy as np

from eval.run.provenance import process_memory
from sshade.progress import silent
from sshade.task import DeformationResult, DeformationTask


def hungry(task: DeformationTask, *, seed: int, progress=silent) -> DeformationResult:
    """Allocate 1 GiB where the limit allows 100 MiB more."""
    limit = process_memory("VmSize") + 100 * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    V = np.ones((2**27, 1))[: task.mesh.n] * task.mesh.V
    return DeformationResult(V, iterations=0, converged=None)


def killed(task: DeformationTask, *, seed: int, progress=silent) -> DeformationResult:
    """Die as a process does that the system kills for lack of memory."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("it lives")

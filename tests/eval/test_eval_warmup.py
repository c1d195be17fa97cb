"""Kernels are compiled before the clock starts."""

import subprocess
import sys

#: Program that prints the kernels that `fine` compiles or loads for two tasks, after its warm-up and that of
#: `fast`. The handles are two small caps in the first task and two large caps in the second task.
COMPILED = """
from numba.core.dispatcher import Dispatcher
from eval.run.config import read_choice, resolved
from eval.run.targets import instantiate
from eval.run.warmup import icosphere, warm_up
from sshade.problem.task import DeformationTask
from tests.shapes import end_handles

for name in ("fast", "fine"):  # of one function, with other kernels
    method = resolved("method", read_choice(name))
    warm_up(method, kind=DeformationTask)
call = instantiate(method)
compiled, compile_now = [], Dispatcher.compile

def compile_told(kernel, signature):
    known = len(kernel.overloads)
    entry = compile_now(kernel, signature)
    compiled.extend([kernel.py_func.__name__] * (len(kernel.overloads) - known))
    return entry

Dispatcher.compile = compile_told
mesh = icosphere(5)
for share in (0.05, 0.4):
    handles = end_handles(mesh.V, share=share, shift=[0.1, 0, 0])
    call(DeformationTask("ball", mesh, handles), seed=0)
    print(*compiled)
    compiled.clear()
"""


def test_after_a_warm_up_nothing_is_compiled_by_landmarks_or_regions():
    told = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True, check=True)
    assert told.stdout.splitlines() == ["", ""]

"""Compiled functions of the package. Numba compiles a :func:`kernel` at its first call for given types."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

import numba

from sshade.core.kernel_store import Store

#: Decorator for a function that only kernels of the same file call. Their machine code includes it.
subroutine = partial(numba.njit, nogil=True)


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that Python calls by numba, without the GIL, and keep its machine code in the store.

    A kernel must not call a compiled function of another file, because the store notices changes of its own
    file only. `options` go to ``numba.njit``.
    """
    if function is None:
        return partial(kernel, **options)
    dispatcher = numba.njit(nogil=True, **options)(function)
    if not numba.config.DISABLE_JIT:
        dispatcher._cache = Store(function)
        dispatcher._compile_for_args = partial(_undisturbed, dispatcher._compile_for_args)
    return dispatcher


def _undisturbed(load: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
    """Load or compile a kernel out of the main thread, where a signal may raise, such as an interrupt.

    An exception inside of numba may leave a lock taken, and all other threads would wait.
    """
    if threading.current_thread() is not threading.main_thread():
        return load(*arguments, **keywords)
    loaded = Future[Any]()

    def work() -> None:
        try:
            loaded.set_result(load(*arguments, **keywords))
        except BaseException as error:
            loaded.set_exception(error)

    threading.Thread(target=work).start()
    return loaded.result()

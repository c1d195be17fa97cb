"""Limits of memory that a shell or a scheduler sets for a process."""

from __future__ import annotations

import sys

#: Bytes of address space that libraries and compiled code need, and the stacks of threads for each CPU.
LIBRARIES, STACKS = 800_000_000, 40_000_000

#: Largest number of bytes for each vertex of a mesh, and for each vertex of a proxy that is solved.
VERTEX, PROXY_VERTEX = 1_400, 8_000

#: Option of ``mallopt``: the largest number of arenas. Each arena reserves 64 MB or more of address space.
_ARENAS = -8


def require_memory(*, vertices: int = 0, proxy_vertices: int = 0, further: int = 0) -> None:
    """Raise MemoryError if a limit of the system leaves too little memory for a command.

    Libraries abort the process, wait for ever or give wrong numbers where they get no memory. Commands
    therefore call this before they import libraries, and again when they know the size of the mesh. Where a
    limit is set, threads share their memory, so that they need little address space.

    Parameters
    ----------
    vertices, proxy_vertices : int
        Numbers of vertices of the mesh, and of the proxies that are solved at the same time.
    further : int
        Bytes that the command needs in addition.
    """
    if sys.platform == "win32":
        return
    import resource

    from sshade.threads import available_cpus

    kinds = {"-v": resource.RLIMIT_AS, "-d": resource.RLIMIT_DATA}
    limits = {flag: resource.getrlimit(kind)[0] for flag, kind in kinds.items()}
    set_limits = {flag: limit for flag, limit in limits.items() if limit != resource.RLIM_INFINITY}
    if not set_limits:
        return
    _share_arenas()
    needed = LIBRARIES + STACKS * available_cpus() + further
    needed += VERTEX * vertices + PROXY_VERTEX * proxy_vertices
    flag, limit = min(set_limits.items(), key=lambda item: item[1])
    if limit < needed:
        raise MemoryError(
            f"this command needs up to {needed / 1e6:,.0f} MB, and the limit is {limit / 1e6:,.0f} MB; "
            f"raise it with `ulimit {flag} {-(-needed // 1024)}`"
        )


def _share_arenas() -> None:
    """Have all threads take memory from one arena, where the C library is glibc."""
    import ctypes

    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(_ARENAS, 1)

"""SShaDe: deform a large mesh through a small proxy and local reference frames.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations".

Names are imported at their first use, so that the package loads quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sshade.core.errors import InputError as InputError
    from sshade.files.arrays import read as read
    from sshade.files.arrays import write as write
    from sshade.files.task_files import read_handles as read_handles
    from sshade.mesh.mesh import Mesh as Mesh
    from sshade.method.bound import Deformer as Deformer
    from sshade.method.call import deform as deform
    from sshade.method.sequence import deform_sequence as deform_sequence
    from sshade.method.transfer import transfer_pose as transfer_pose
    from sshade.plotting.figure import plot as plot
    from sshade.problem.handles import Handles as Handles
    from sshade.problem.task import DeformationResult as DeformationResult
    from sshade.problem.task import DeformationTask as DeformationTask
    from sshade.problem.task import Method as Method
    from sshade.problem.task import TransferTask as TransferTask
    from sshade.proxy.along import move_along as move_along
    from sshade.proxy.bind import bind as bind
    from sshade.proxy.binding import Binding as Binding
    from sshade.proxy.binding_file import load_binding as load_binding
    from sshade.proxy.binding_file import save_binding as save_binding

    __version__: str

_MODULES = {
    "core.errors": ["InputError"],
    "files.arrays": ["read", "write"],
    "files.task_files": ["read_handles"],
    "mesh.mesh": ["Mesh"],
    "method.call": ["deform"],
    "method.bound": ["Deformer"],
    "proxy.bind": ["bind"],
    "method.sequence": ["deform_sequence"],
    "method.transfer": ["transfer_pose"],
    "plotting.figure": ["plot"],
    "problem.handles": ["Handles"],
    "problem.task": ["DeformationResult", "DeformationTask", "Method", "TransferTask"],
    "proxy.along": ["move_along"],
    "proxy.binding": ["Binding"],
    "proxy.binding_file": ["load_binding", "save_binding"],
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("sshade")
    elif name in _HOME:
        value = getattr(import_module(f"sshade.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module 'sshade' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

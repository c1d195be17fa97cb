"""SShaDe: deform a large mesh through a small proxy and local reference frames.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations".

Names are imported at their first use, so that the package loads quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sshade.carry.along import move_along as move_along
    from sshade.carry.binding import Binding as Binding
    from sshade.carry.binding_file import load_binding as load_binding
    from sshade.carry.binding_file import save_binding as save_binding
    from sshade.edit.call import edit_handles as edit_handles
    from sshade.errors import InputError as InputError
    from sshade.handles import Handles as Handles
    from sshade.io.arrays import read as read
    from sshade.io.arrays import write as write
    from sshade.mesh.mesh import Mesh as Mesh
    from sshade.pipeline.deform import deform as deform
    from sshade.pipeline.deformer import Deformer as Deformer
    from sshade.pipeline.proxies import bind as bind
    from sshade.pipeline.sequence import deform_sequence as deform_sequence
    from sshade.pipeline.transfer import transfer_pose as transfer_pose
    from sshade.plotting.figure import plot as plot
    from sshade.task import DeformationResult as DeformationResult
    from sshade.task import DeformationTask as DeformationTask
    from sshade.task import Method as Method
    from sshade.task import TransferTask as TransferTask

    __version__: str

_MODULES = {
    "carry.along": ["move_along"],
    "carry.binding": ["Binding"],
    "carry.binding_file": ["load_binding", "save_binding"],
    "edit.call": ["edit_handles"],
    "errors": ["InputError"],
    "handles": ["Handles"],
    "io.arrays": ["read", "write"],
    "mesh.mesh": ["Mesh"],
    "pipeline.deform": ["deform"],
    "pipeline.deformer": ["Deformer"],
    "pipeline.proxies": ["bind"],
    "pipeline.sequence": ["deform_sequence"],
    "pipeline.transfer": ["transfer_pose"],
    "plotting.figure": ["plot"],
    "task": ["DeformationResult", "DeformationTask", "Method", "TransferTask"],
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
    return sorted({*globals(), *__all__, "__version__"})

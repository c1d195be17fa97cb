"""SShaDe: deform a large mesh through a small proxy and local reference frames.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations".
"""

from importlib.metadata import version

from sshade.carry.binding import Binding
from sshade.carry.binding_file import load_binding, save_binding
from sshade.errors import InputError
from sshade.io.arrays import read, write
from sshade.mesh.mesh import Mesh
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.fine import sshade_fine
from sshade.pipeline.paper import sshade
from sshade.pipeline.proxies import bind
from sshade.pipeline.transfer import TransferTask, transfer_pose
from sshade.task import DeformationResult, DeformationTask, Handles, Method

__all__ = [
    "Binding",
    "DeformationResult",
    "DeformationTask",
    "Deformer",
    "Handles",
    "InputError",
    "Mesh",
    "Method",
    "TransferTask",
    "bind",
    "deform",
    "load_binding",
    "read",
    "save_binding",
    "sshade",
    "sshade_fast",
    "sshade_fine",
    "transfer_pose",
    "write",
]

__version__ = version("sshade")

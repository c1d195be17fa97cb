"""SShaDe: deform a large mesh through a small proxy and local reference frames.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations".
"""

from sshade.carry.binding import Binding
from sshade.carry.binding_file import load_binding, save_binding
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.pipeline.components import deform_components
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.fine import sshade_fine
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
    "deform_components",
    "load_binding",
    "save_binding",
    "sshade_fast",
    "sshade_fine",
    "transfer_pose",
]

"""SShaDe: deform a large mesh through a small proxy and local reference frames.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations".
"""

from sshade.carry.binding import Binding, bind
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.pipeline.components import deform_pieces
from sshade.pipeline.deform import deform
from sshade.pipeline.deformer import Deformer
from sshade.pipeline.fine import sshade_fast, sshade_fine
from sshade.pipeline.transfer import reconstruct, transfer_pose
from sshade.pipeline.transfer_task import TransferTask
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
    "deform_pieces",
    "reconstruct",
    "sshade_fast",
    "sshade_fine",
    "transfer_pose",
]

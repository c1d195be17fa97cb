"""SShaDe: deform a large mesh through a small proxy and local reference frames.

F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
deformation via local representations".
"""

from sshade.binding import Binding, bind
from sshade.deformer import Deformer
from sshade.errors import InputError
from sshade.fine import sshade_fast, sshade_fine
from sshade.mesh import Mesh
from sshade.pieces import deform_pieces
from sshade.pipeline import deform
from sshade.task import DeformationResult, DeformationTask, Handles, Method
from sshade.transfer import reconstruct, transfer_pose
from sshade.transfer_task import TransferTask

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

"""Files: meshes, handles, and output that appears whole or not at all."""

from sshade.io.arrays import read, write
from sshade.io.document import MeshFile
from sshade.io.meshes import read_file, read_mesh, write_file, write_mesh

__all__ = ["MeshFile", "read", "read_file", "read_mesh", "write", "write_file", "write_mesh"]

"""Files: meshes, handles, and output that appears whole or not at all."""

from sshade.io.meshes import read_mesh, write_mesh

__all__ = ["read_mesh", "write_mesh"]

"""Files: meshes, handles, and output that appears whole or not at all."""

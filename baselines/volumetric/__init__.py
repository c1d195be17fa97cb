"""Methods that deform coarse tetrahedra, or voxels, around the mesh, and carry it with them."""

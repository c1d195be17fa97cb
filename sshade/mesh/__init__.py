"""Triangle meshes: the validated type, connectivity, adjacency, cutting into manifolds, a tree of boxes."""

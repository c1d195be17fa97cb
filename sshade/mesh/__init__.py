"""Triangle meshes: the validated type, connectivity, graph, cutting into manifolds, seams."""

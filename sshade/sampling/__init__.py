"""From M to N: farthest point sampling, Voronoi cells, the closed-ball test, the dual triangulation.

Read in this order: `proxy` (all steps), `fronts` (farthest point sampling and cells) with its kernels in
`advance`, `coarse` (the same result type for large meshes, faster), and `closed_ball`.
"""

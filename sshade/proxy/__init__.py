"""From M to N, and from N' to M': sampling, the binding of M to N, and local frames.

Sampling, in this order: `sample` (all steps), `fronts` (farthest point sampling and cells) with its kernels
in `advance`, `coarse` (the same result type for large meshes, faster), and `closed_ball`. Prolonging:
`projection`, `frames` (the interface), `triangle` (the paper's frames), `blended`, `binding` and
`binding_file`. `vertex_maps` is shared.
"""

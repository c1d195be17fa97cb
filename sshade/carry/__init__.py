"""Prolong the deformed proxy N' to the mesh M': projection onto N, local frames, and the binding of M to N.

Read in this order: `projection`, `frames` (the interface), `triangle` (the paper's frames), `blended`,
`affine` (an ablation), `kinds` (frames by name), `binding` and `binding_file`. `vertex_maps` and `neighbours`
are shared.
"""

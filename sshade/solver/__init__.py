"""Deform a proxy: minimise an as-rigid-as-possible energy under handles and constraints.

Read in this order: `local_global` (the solver), `system` (all that depends on mesh and handle vertices),
`energy` with its `terms`, `factorisation` and `cycles` with `multigrid` (the solve of the global step),
`constraints` (volume and area), `descent` (one iteration) with `quasi_newton`, `run` (the loop and its
result), and `following` (solves in a row). `attachment` decides which vertices handle groups pull. `order`,
`cotangents` and `rotations` are shared.
"""

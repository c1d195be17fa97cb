"""Deform a proxy: minimise an as-rigid-as-possible energy under handles and constraints.

Read in this order: `local_global` (the solver), `system` (all that depends on mesh and handle vertices),
`descent` (the energy and one iteration) with `terms` and `quasi_newton`, `factorisation` and `multigrid` (the
solve of the global step), `constraints` (volume and area), `run` (the loop and its result), and `drag`
(solves in a row). `attachment` decides which vertices handle groups pull. `laplacian` is shared.
"""

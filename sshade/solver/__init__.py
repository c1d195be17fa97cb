"""Deform a proxy: minimise an as-rigid-as-possible energy under handles and constraints.

Read in this order: `local_global` (the solver), `system` (all that depends on mesh and handle
vertices), `energy` with its `terms`, `linear` (the solve of the global step) with `factorisation` and
`multigrid`, `constraints` (volume and area), `descent` (one iteration) with `quasi_newton`, `run` (the loop),
`solution` (the result), and `following` (solves in a row). `attachment` decides which vertices handle groups
pull, and `start` where iterations begin. `order`, `cotangents` and `rotations` are shared.
"""

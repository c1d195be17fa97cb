"""From N to N': as-rigid-as-possible energies, their local/global iteration, and what may be added to it.

To be read in this order: `options` and `start` (what a user sets), `local_global` (the solver and
the method), `arap` (system and iteration) with `cotangents`, `terms`, `rotations` (local step) and
`global_step` with `factorisation`, `substitution` or `multigrid`, `quasi_newton` (acceleration and
its safeguard);
then what goes beyond the published energy: `constraints` with `volume_area`, `strain_softening`.
"""

"""From N to N': as-rigid-as-possible energies, their local/global iteration, and what may be added to it."""

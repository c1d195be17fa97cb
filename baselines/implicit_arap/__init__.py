"""Implicit-ARAP: a neural deformation field that is as rigid as possible on the level sets of an SDF.

D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP: Efficient Handle-Guided
Deformation of High-Resolution Meshes and Neural Fields via Local Patch Meshing", 2024.

The package can be imported without torch; the function needs the extra ``torch``.
"""

from baselines.implicit_arap.method import implicit_arap

__all__ = ["implicit_arap"]

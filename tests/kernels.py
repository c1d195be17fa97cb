"""Kinds of OpenBLAS's kernels that this processor can run: tests choose one by OPENBLAS_CORETYPE."""

import llvmlite.binding

#: Each with the feature of a processor that it needs.
_NEEDED = {"Prescott": "sse3", "Haswell": "avx2", "SkylakeX": "avx512f"}
OFFERED = [kind for kind, feature in _NEEDED.items() if llvmlite.binding.get_host_cpu_features().get(feature)]

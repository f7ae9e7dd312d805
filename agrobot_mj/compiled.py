"""How scalar kernels are compiled: cached on disk, without the GIL; plain Python under `NUMBA_DISABLE_JIT=1`."""

from numba import njit

jit = njit(cache=True, nogil=True)

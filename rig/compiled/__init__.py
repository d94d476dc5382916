"""What compiled code needs.

c_functions   formulas of parts as C functions, which kernels call
kernel        the one decorator for compiled code, with a cache that never runs outdated physics
kernel_store  compiled kernels in the user's cache, under the hash of their sources
records       records lent to kernels
"""

import os
import sys

if os.environ.get("RIG_OWN_PROCESS") and "yaml" not in sys.modules and not os.path.exists(".numba_config.yaml"):
    sys.modules["yaml"] = None  # type: ignore[assignment]  # numba imports it to read this file (20 ms)
    import numba  # noqa: F401

    del sys.modules["yaml"]

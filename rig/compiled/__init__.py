"""What compiled code needs.

c_functions   formulas of parts as C functions, which kernels call
kernel        the one decorator for compiled code, with a cache that never runs outdated physics
kernel_store  compiled kernels in the user's cache, under the hash of their sources
records       records lent to kernels
"""

import os
import sys

if os.environ.get("RIG_OWN_PROCESS"):
    # numba imports yaml to read a file (20 ms), and scipy to ask for its version (20 ms)
    _left_out = {"scipy"} if os.path.exists(".numba_config.yaml") else {"scipy", "yaml"}
    _left_out -= sys.modules.keys()
    sys.modules |= dict.fromkeys(_left_out)  # type: ignore[arg-type]
    import numba  # noqa: F401

    for _name in _left_out:
        del sys.modules[_name]

"""What compiled code needs.

c_functions   formulas of parts as C functions, which kernels call
kernel        the one decorator for compiled code, with a cache that never runs outdated physics
kernel_store  compiled kernels in the user's cache, under the hash of their sources
records       records lent to kernels
"""

import gc
import os
import sys

_left_out: set[str] = set()
if os.environ.get("RIG_OWN_PROCESS"):
    # numba imports yaml to read a file (20 ms), and scipy to ask for its version (20 ms)
    _left_out = {"scipy"} if os.path.exists(".numba_config.yaml") else {"scipy", "yaml"}
    _left_out -= sys.modules.keys()
_collecting = gc.isenabled()
gc.disable()  # what an import makes stays; to look through it for garbage takes 60 ms
sys.modules |= dict.fromkeys(_left_out)  # type: ignore[arg-type]
import numba  # noqa: E402, F401

for _name in _left_out:
    del sys.modules[_name]
if not gc.get_freeze_count():
    gc.freeze()
    gc.unfreeze()  # all of it belongs to the oldest generation now
if _collecting:
    gc.enable()

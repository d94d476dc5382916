"""What processes must have in common to compute the same bits: sources, kernels, and the type of processor."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rig import kernel
from rig.record.provenance import blas, processor

_ROOT = Path(__file__).resolve().parents[2]


@cache
def sources() -> str:
    """Return version and hash (12 hex digits) of all sources and of what the kernels depend on."""
    found = hashlib.sha256(kernel.source_key().encode())
    for path in sorted(_ROOT.rglob("*.py")):
        found.update(path.relative_to(_ROOT).as_posix().encode() + path.read_bytes())
    try:
        number = version("friction-rig")
    except PackageNotFoundError:  # run from the sources without installation
        number = "from sources"
    return f"friction-rig {number}, sources {found.hexdigest()[:12]}"


@cache
def this_processor() -> str:
    """Return the type of this processor and its linear algebra: results have the same bits on one type."""
    return f"{processor()}, {blas()}"

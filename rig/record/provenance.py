"""The provenance of a run: versions, machine, sources, seed, command. The plant states it; the recording stores it."""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from ctypes import CDLL
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path

from rig.printable import printable

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("friction-rig", "numpy", "scipy", "numba", "eclipse-zenoh", "mcap", "protobuf")


def provenance(seed: int, command: Sequence[str] = tuple(sys.argv)) -> dict[str, str]:
    """Return everything that is needed to repeat the run."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": printable(shlex.join([Path(command[0]).name, *command[1:]])) if command else "",
        "seed": str(seed),
        **_sources_and_machine(),
    }


@cache
def _sources_and_machine() -> dict[str, str]:
    """What stays the same while a process runs: its sources, as they were loaded, and the machine."""
    from rig.compiled.kernel import source_key  # loads numba, which the recorder does not need

    return {
        "kernel": source_key(),
        "commit": _commit(),
        "host": platform.node(),
        "system": platform.platform(),
        "processor": processor(),
        "blas": blas(),
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        **{package: package_version(package) for package in _PACKAGES},
    }


def package_version(package: str) -> str:
    """The version of an installed package."""
    try:  # `importlib.metadata.version` reads all of the text as an e-mail, 2 ms for each package
        lines = (distribution(package).read_text("METADATA") or "").splitlines()
    except PackageNotFoundError:  # run from the sources without installation
        return "not installed"
    return next((line[9:] for line in lines if line.startswith("Version: ")), "unknown")


def _commit() -> str:
    """Commit of the sources, with "-dirty" when they were edited since; "none" outside of a repository."""
    if not (_ROOT / ".git").exists():
        return "none"
    ask = ["git", "-C", str(_ROOT), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        return subprocess.run(ask, capture_output=True, text=True, timeout=5.0, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return "none"


def processor() -> str:
    """Name and instruction set: processors of one name may differ in it, and then round differently."""
    import llvmlite.binding  # numba has loaded it

    features = llvmlite.binding.get_host_cpu_features().flatten()
    instructions = hashlib.sha256(features.encode()).hexdigest()[:8]
    return f"{_model_name()} ({llvmlite.binding.get_host_cpu_name()}, instructions {instructions})"


def blas() -> str:
    """The libraries of linear algebra of numpy and scipy, each with the processor for which its kernels are written.

    OpenBLAS chooses these kernels at run time: an environment variable or a hypervisor that hides instructions changes
    the last bits of matrices, and so those of a run.
    """
    from threadpoolctl import threadpool_info

    scipy = find_spec("scipy")  # only what is loaded is found; importing all of scipy.linalg takes 0.1 s
    for module in (Path(scipy.origin).parent / "linalg").glob("_fblas*") if scipy and scipy.origin else ():
        with suppress(OSError):
            CDLL(str(module))
    libraries = set[str]()
    for library in threadpool_info():
        if library["user_api"] == "blas":
            known = (library.get(key) for key in ("internal_api", "version", "architecture"))
            libraries.add(" ".join(str(value) for value in known if value))
    return ", ".join(sorted(libraries)) or "unknown"


def _model_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()

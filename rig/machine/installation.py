"""Which installation this process runs: processes on several hosts must have the same one."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]


def number() -> str:
    """The version of the installed package; "from sources" without an installation."""
    try:
        return version("friction-rig")
    except PackageNotFoundError:
        return "from sources"


@cache
def digest() -> bytes:
    """Hash (SHA-256) of all Python files of the package, by name and content."""
    content = hashlib.sha256()
    for path in sorted(_ROOT.rglob("*.py")):
        content.update(path.relative_to(_ROOT).as_posix().encode() + path.read_bytes())
    return content.digest()


def described(more: str = "") -> str:
    """Version and hash (12 hex digits) of the sources; `more`: what else counts as a source."""
    return f"friction-rig {number()}, sources {hashlib.sha256(digest() + more.encode()).hexdigest()[:12]}"

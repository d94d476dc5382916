"""Optional libraries: imported where they are used; a missing one is named with the line that installs it.

The project is in no package index: a package of its name there would be somebody else's. So the lines name its folder
and its wheel.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from contextlib import redirect_stdout
from typing import Any

from rig.errors import UsageError


def needed(name: str, extra: str) -> Any:
    """The module of an optional library, which the extra `extra` of the project installs.

    Raises UsageError with what to install if it cannot be loaded. What a library prints while it is imported goes to
    standard error.
    """
    try:
        with redirect_stdout(sys.stderr):
            return importlib.import_module(name)
    except ImportError as fault:
        raise UsageError(f"{name} cannot be loaded ({fault}); {installed_by(extra)}") from None


def installed_by(extra: str) -> str:
    """The words that say how the libraries of the extra `extra` are installed."""
    return (
        f"to install it: python -m pip install -e '.[{extra}]' in the project's folder, or "
        f"python -m pip install './friction_rig-VERSION-py3-none-any.whl[{extra}]' beside its wheel"
    )


def check(name: str, extra: str, what: str) -> None:
    """Raise UsageError if the library `name` of the extra `extra`, which `what` needs, is not installed.

    It is not imported: this costs nothing at a start.
    """
    if importlib.util.find_spec(name) is None:
        raise UsageError(f"{what} needs {name}, which is not installed; {installed_by(extra)}")

"""Optional libraries: imported where they are used; a missing one is named with the line that installs it."""

from __future__ import annotations

import importlib
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
        raise UsageError(
            f"{name} cannot be loaded ({fault}); pip install 'friction-rig[{extra}]' installs it"
        ) from None

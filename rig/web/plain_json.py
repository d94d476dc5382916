"""JSON of what comes from other processes: a number that is not finite, which JSON does not have, is null."""

from __future__ import annotations

import json
import math
from typing import Any

from starlette.responses import JSONResponse


def finite(content: Any) -> Any:
    """The same without numbers that JSON does not have."""
    if isinstance(content, dict):
        return {key: finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def text(content: Any) -> str:
    """The JSON text of `content`."""
    return json.dumps(finite(content), allow_nan=False)


class Answer(JSONResponse):
    """An answer in JSON."""

    def render(self, content: Any) -> bytes:
        """The body of the answer."""
        return super().render(finite(content))

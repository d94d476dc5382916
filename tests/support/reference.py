"""Numbers of independent code (tests/reference), and the rig's eigenvalues in the form in which they are compared."""

import json
import math
from functools import cache
from pathlib import Path


@cache
def numbers(name):
    """What tests/reference/NAME.json contains."""
    return json.loads((Path(__file__).parents[1] / "reference" / f"{name}.json").read_text())


def in_order(values):
    """Eigenvalues [1/s] without the conjugate ones, by frequency and growth."""
    return sorted((v for v in values if v.imag >= 0.0), key=lambda v: (round(v.imag, 4), v.real))


def rates(sliding):
    """The eigenvalues [1/s] of sliding that `rig.modes` tells, in this order."""
    return in_order([complex(mode.growth, 2.0 * math.pi * mode.frequency) for mode in sliding.modes])

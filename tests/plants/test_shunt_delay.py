"""Why the shunt is inside the plant: over a link its resistance is less by delay / Cps. The numbers of docs/shunt.md.

The stack is held; what the network hears of its voltage is late by tau: L s^2 + R s + (exp(-s tau) + delta)/Cps = 0.
"""

import cmath
import json
import math
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ORACLE = json.loads((ROOT / "tests" / "reference" / "kroger_shunt.json").read_text())
CPS = ORACLE["Cps"]
LATE = (0.0, 1e-6, 2e-6, 20e-6)


def longest(L, R, delta):
    """The delay at which a root reaches the imaginary axis: |exp(-i w tau)| = 1 gives w, its angle tau."""
    a, b, c = (L * CPS) ** 2, (R * CPS) ** 2 - 2.0 * delta * L * CPS, delta**2 - 1.0
    w = math.sqrt((-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a))
    return math.atan2(R * CPS * w, L * CPS * w * w - delta) / w


def root(L, R, delta, tau):
    """The root near the resonance of the loop [1/s], by Newton's method."""
    s = 1j * math.sqrt((1.0 + delta) / (L * CPS))
    for _ in range(50):
        late = cmath.exp(-s * tau)
        s -= (L * s * s + R * s + (late + delta) / CPS) / (2.0 * L * s + R - tau * late / CPS)
    return s


def rows():
    return [(case["L"], case["R"], case["delta"]) for case in ORACLE["delay"]]


@pytest.mark.parametrize("case", ORACLE["delay"], ids=lambda case: f"{case['delta']:g}")
def test_the_longest_delay_is_that_of_the_reference(case):
    found = longest(case["L"], case["R"], case["delta"])
    assert found == pytest.approx(case["tau_max"], rel=1e-6)
    assert found == pytest.approx(case["R"] * CPS, rel=2e-4)
    for tau, sign in ((0.999 * found, -1.0), (1.001 * found, 1.0)):
        assert sign * root(case["L"], case["R"], case["delta"], tau).real > 0.0


def test_the_page_tells_these_numbers():
    page = (ROOT / "docs" / "shunt.md").read_text(encoding="utf-8")
    for L, R, delta in rows():
        rates = " | ".join(f"{root(L, R, delta, tau).real:+.0f}" for tau in LATE)
        assert f"| {delta:g} | {R:g} | {L * 1e3:.3f} | {longest(L, R, delta) * 1e6:.4f} | {rates} |" in page

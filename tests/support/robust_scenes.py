"""Scenes and boxes with known robust designs.

Boxes of shipped scenes: the shunt of the brake (SHUNT against STACK), the belt (BELT) and its loop (LOOPED). Scenes of
matrices: three flutter pairs on a disc, and a mass with an absorber.
"""

import numpy as np

from rig.analysis.robust.tasks import Computer, Tasks

FORMULA = 0.03647488974112161  # H, of the shipped shunt
SHUNT = {
    "shunt.resistance": "5 ohm:300 ohm",
    "shunt.inductance": (0.1 * FORMULA, 1.6 * FORMULA),
    "shunt.delta": (-0.85, -0.2),
}
STACK = {
    "friction.mu": "+-2 %",
    "piezo.capacitance": "+-5 %",
    "shunt.delta": "+-5 %",
    "shunt.inductance": "+-5 %",
}
BELT = {"friction.mu_static": "+-10 %", "friction.mu_dynamic": "+-10 %", "drive.speed": "+-10 %"}
LOOPED = {**BELT, "controllers.nf.delay": "0 ms:20 ms"}
BASE = [(1.6e6, -4.0e5, 0.8e6), (3.7e6, -9.0e5, 1.9e6), (6.9e6, -1.5e6, 4.1e6)]
SPRINGS = (1.0e6, 2.0e6, 3.0e6)
DAMPERS = ("c1", "c2", "c3", "cd")


def here(growth, limits=()):
    """Tasks that this process computes when they are asked for."""
    computer = Computer(lambda: growth, limits)
    return Tasks(growth, limits, lambda units, _: [computer(unit, *given) for unit, given in units.items()])


def _part(name, of, matrix, times=""):
    lines = [f"[structure.parts.{name}]", f'of = "{of}"', f'values = [{np.asarray(matrix).tolist()}, "chosen"]']
    return [*lines, *([f'times = "{times}"'] if times else [])]


def _head(title, coordinates):
    names = ", ".join(f'"{name}"' for name in coordinates)
    return [
        "format = 1",
        f'title = "{title}"',
        'plant = "structure"',
        "[structure]",
        'units = "m-kg-s"',
        f"coordinates = [{names}]",
    ]


def three_pairs():
    """Three pads of two degrees of freedom on a disc that moves across: seven coordinates, four dampers factors.c..."""
    coordinates = ["a1", "n1", "a2", "n2", "a3", "n3", "disc"]
    stiffness = np.zeros((7, 7))
    stiffness[6, 6] = 4e6
    for i, (xx, xy, yy) in enumerate(BASE):
        stiffness[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[xx, xy], [xy, yy]]
    lines = _head("Three pads on a disc", coordinates)
    lines += _part("M", "mass", np.diag([1.0] * 6 + [4.0]))
    lines += _part("K", "stiffness", stiffness)
    lines += _part("D", "damping", np.eye(7))
    for name, at in zip(DAMPERS, (0, 2, 4, 6)):
        lines += _part(name, "damping", np.diag(np.eye(7)[at]), f"factors.{name}")
    lines += ["[factors]", *(f'{name} = [50.0, "chosen"]' for name in DAMPERS)]
    for i, spring in enumerate(SPRINGS, 1):
        lines += [f"[contacts.pad{i}]", f'gap = {{ n{i} = [1.0, "chosen"], disc = [-1.0, "chosen"] }}']
        lines += [f'along = {{ a{i} = [1.0, "chosen"] }}', 'radius = ["0.1 m", "chosen"]']
        lines += [f'spring = ["{spring:g} N/m", "chosen"]']
    lines += ["[drive]", 'speed = ["5 rad/s", "chosen"]', 'axis = "z"', "[load]", 'force = ["300 N", "chosen"]']
    for i in (1, 2, 3):
        lines += [f"[load.at.pad{i}]", f'row = {{ n{i} = [-1.0, "chosen"] }}']
    lines += ["[friction]", 'law = "constant"', 'mu = ["0.45", "chosen"]', "[clock]", 'frame = ["0.001 s", "chosen"]']
    return "\n".join([*lines, ""])


def absorber(ratio, aside=0.0):
    """An undamped mass of 1 kg at 1 rad/s with an absorber of `ratio` kg: factors.f2 and factors.fz are the square of
    its frequency and frequency times damping ratio; factors.k the stiffness of the mass. Another mass, at 3 rad/s,
    decays beside them with the rate `aside`.
    """
    apart = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    count = 3 if aside else 2
    lines = _head("A mass with an absorber", ["body", "absorber", "aside"][:count])
    parts = {
        "M": ("mass", np.diag([1.0, ratio, 1.0]), ""),
        "K": ("stiffness", np.diag([1.0, 0.0, 0.0]), "factors.k"),
        "KA": ("stiffness", ratio * apart, "factors.f2"),
        "DA": ("damping", 2.0 * ratio * apart, "factors.fz"),
    }
    if aside:
        parts["KO"] = "stiffness", np.diag([0.0, 0.0, 9.0]), ""
        parts["DO"] = "damping", np.diag([0.0, 0.0, 2.0 * aside]), ""
    for name, (of, matrix, times) in parts.items():
        lines += _part(name, of, matrix[:count, :count], times)
    lines += ["[factors]", 'k = [1.0, "chosen"]', 'f2 = [1.0, "chosen"]', 'fz = [0.1, "chosen"]']
    lines += ["[clock]", 'frame = ["0.001 s", "chosen"]']
    return "\n".join([*lines, ""])

"""The finite element brake of tests/data/brake_fe: its files as parts, and its matrices."""

from functools import cache
from pathlib import Path

from rig.structure.full import Full
from rig.structure.read import Source, structure

FOLDER = Path(__file__).parents[1] / "data" / "brake_fe"
SPEED, FRICTION = "drive.speed", "factors.friction"


def _part(name, of, file, stored="upper", **scaled):
    return Source(name, of, FOLDER / f"{file}.npz", stored=stored, **scaled)


SOURCES = (
    _part("M", "mass", "BMLL"),
    _part("D1", "damping", "BDLL"),
    _part("DR", "damping", "BDIWLL", key=SPEED, power=-1),
    _part("DG", "damping", "BYLL", stored="full", key=SPEED),
    _part("D4", "damping", "BHLL", factor=1.0 / 1600.0),
    _part("K1", "stiffness", "BKLL"),
    _part("KR", "stiffness", "BKQLL", stored="full", key=FRICTION),
    _part("KGEO", "stiffness", "BWLL", key=SPEED, power=2),
)


@cache
def brake() -> Full:
    """The full matrices."""
    return structure(SOURCES, "mm-t-s")[0]

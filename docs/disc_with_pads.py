"""Finite element input of a disc with two brake pads: `python docs/disc_with_pads.py FOLDER`; page structure.md.

    disc.inp               the mesh: nodes, elements C3D8I, node sets, materials, springs of the pads; SI units
    disc_matrices.inp      `ccx -i disc_matrices` writes the matrices: disc_matrices.sti, .mas, .dof
    disc_frequencies.inp   `ccx -i disc_frequencies` writes frequencies: disc_frequencies.dat

The disc of cast iron is clamped at its bore. Each pad, a lining on a back plate of steel, covers 48 degrees. Its back
plate is held by springs. `--shift 0.5` turns the pads by half an element, so that the meshes do not match.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

RADII = (0.060, 0.072, 0.080, 0.0895, 0.099, 0.1085, 0.118, 0.125)  # m
AROUND = 60  # elements around the disc
HEIGHTS = (-0.006, 0.0, 0.006)  # of the disc [m]
PAD_RADII = RADII[2:7]
PAD_ANGLES = range(-4, 5)  # elements of the disc
PAD_HEIGHTS = (0.006, 0.011, 0.016, 0.021)  # the lining is two elements thick, the back plate one [m]
MATERIALS = {"IRON": (1.1e11, 0.26, 7100.0), "LINING": (8e9, 0.3, 2500.0), "STEEL": (2.1e11, 0.3, 7850.0)}
SPRINGS = (2e7, 2e7, 2e5)  # of one pad along x, y, z [N/m]

Place = tuple[int, int, int]  # number along the radius, around, along z


class Deck:
    """Numbers nodes and elements, and writes the mesh."""

    def __init__(self) -> None:
        self.nodes: list[tuple[float, float, float]] = []
        self.elements: dict[str, list[list[int]]] = {name: [] for name in MATERIALS}
        self.sets: dict[str, list[int]] = {}

    def ring(self, radii: Iterable[float], angles: Iterable[float], heights: Iterable[float]) -> dict[Place, int]:
        """The numbers of new nodes on a grid."""
        placed = {}
        for k, z in enumerate(heights):
            for j, angle in enumerate(angles):
                for i, r in enumerate(radii):
                    self.nodes.append((r * math.cos(angle), r * math.sin(angle), z))
                    placed[i, j, k] = len(self.nodes)
        return placed

    def fill(self, node: Callable[[int, int, int], int], i: int, j: int, k: int, material: str) -> None:
        """A brick between two neighbours along each direction."""
        lower, upper = [
            [node(i, j, h), node(i + 1, j, h), node(i + 1, j + 1, h), node(i, j + 1, h)] for h in (k, k + 1)
        ]
        self.elements[material].append(lower + upper)

    def lines(self) -> Iterator[str]:
        """The lines of the mesh."""
        yield "*NODE, NSET=ALL"
        for number, place in enumerate(self.nodes, 1):
            yield f"{number}, " + ", ".join(f"{x:.9e}" for x in place)
        number = 0
        for material, bricks in self.elements.items():
            yield f"*ELEMENT, TYPE=C3D8I, ELSET={material}"
            for brick in bricks:
                number += 1
                yield ", ".join(map(str, (number, *brick)))
        for material, (young, poisson, density) in MATERIALS.items():
            yield f"*MATERIAL, NAME={material}\n*ELASTIC\n{young:.3e}, {poisson}\n*DENSITY\n{density:.1f}"
            yield f"*SOLID SECTION, ELSET={material}, MATERIAL={material}"
        for name, members in self.sets.items():
            yield f"*NSET, NSET={name}"
            yield from (", ".join(map(str, members[at : at + 12])) + "," for at in range(0, len(members), 12))
        backs = self.sets["BACK_UP"] + self.sets["BACK_DOWN"]
        for direction, stiffness in enumerate(SPRINGS, 1):
            yield f"*ELEMENT, TYPE=SPRING1, ELSET=SPRINGS{direction}"
            for back in backs:
                number += 1
                yield f"{number}, {back}"
            # real numbers need a point or an exponent: CalculiX refuses 444444
            yield f"*SPRING, ELSET=SPRINGS{direction}\n{direction}\n{2.0 * stiffness / len(backs):.6e}"
        yield "*BOUNDARY\nBORE, 1, 3"


def mesh(shift: float = 0.0) -> Iterator[str]:
    """The lines of disc.inp; `shift` turns the pads by so many elements of the disc."""
    deck, pitch = Deck(), 2.0 * math.pi / AROUND
    disc = deck.ring(RADII, [pitch * j for j in range(AROUND)], HEIGHTS)
    for k in range(len(HEIGHTS) - 1):
        for j in range(AROUND):
            for i in range(len(RADII) - 1):
                deck.fill(lambda i, j, k: disc[i, j % AROUND, k], i, j, k, "IRON")
    deck.sets["BORE"] = [disc[0, j, k] for j in range(AROUND) for k in range(len(HEIGHTS))]
    for side, name in ((1.0, "UP"), (-1.0, "DOWN")):
        heights = sorted(side * z for z in PAD_HEIGHTS)
        pad = deck.ring(PAD_RADII, [pitch * (j + shift) for j in PAD_ANGLES], heights)
        back, face = (3, 0) if side > 0 else (0, 3)
        for k in range(3):
            material = "STEEL" if k == min(back, 2) else "LINING"
            for j in range(len(PAD_ANGLES) - 1):
                for i in range(len(PAD_RADII) - 1):
                    deck.fill(lambda i, j, k: pad[i, j, k], i, j, k, material)  # noqa: B023
        deck.sets[f"PAD_{name}"] = [number for (_, _, k), number in pad.items() if k == face]
        deck.sets[f"BACK_{name}"] = [number for (_, _, k), number in pad.items() if k == back]
        surface = len(HEIGHTS) - 1 if side > 0 else 0
        deck.sets[f"DISC_{name}"] = [number for (_, _, k), number in disc.items() if k == surface]
    return deck.lines()


def write(folder: Path, shift: float = 0.0) -> None:
    """Write the three files."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "disc.inp").write_text("\n".join(mesh(shift)) + "\n")
    for name, keyword in (("matrices", "*FREQUENCY, SOLVER=MATRIXSTORAGE"), ("frequencies", "*FREQUENCY")):
        text = f"*INCLUDE, INPUT=disc.inp\n*STEP\n{keyword}\n40\n*END STEP\n"
        (folder / f"disc_{name}.inp").write_text(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shift", type=float, default=0.0, help="turns the pads, in elements of the disc")
    options = parser.parse_args()
    write(options.folder, options.shift)

"""The disc with two pads of docs/disc_with_pads.py: its mesh, the matrices that CalculiX made, and its contacts."""

import lzma
import re
import runpy
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from rig.structure.contacts import Contact, contact_points
from rig.structure.full import Full
from rig.structure.mesh import Mesh, Selection
from rig.structure.read import structure

DATA = Path(__file__).parents[1] / "data" / "disc_with_pads"
DECK = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "disc_with_pads.py"))


def unpacked(folder: Path) -> Path:
    """Write the deck and the stored matrices of CalculiX into a folder; the name of the job."""
    DECK["write"](folder)
    for suffix in ("sti", "mas", "dof"):
        name = f"disc_matrices.{suffix}"
        (folder / name).write_bytes(lzma.decompress((DATA / f"{name}.xz").read_bytes()))
    return folder / "disc_matrices"


def frequencies(output: Path = DATA / "disc_frequencies.dat"):
    """The frequencies [Hz] in a .dat file of CalculiX."""
    number = r"\s+([-+.0-9E]+)"
    lines = re.findall(rf"^\s+\d+{number * 4}$", output.read_text(), re.MULTILINE)
    return np.array([float(line[2]) for line in lines])


@cache
def disc() -> tuple[Full, Mesh]:
    """The matrices and the mesh."""
    with tempfile.TemporaryDirectory() as folder:
        job = unpacked(Path(folder))
        return structure([], "m-kg-s", job=job, nodes=job.with_name("disc.inp"))


def contacts(points, **changes):
    """The descriptions of both contacts with so many points on each pad."""
    about_z = {"normal": (0.0, 0.0, 1.0), "axis": (0.0, 0.0, 1.0), "points": points}
    return [
        Contact(f"pad_{side}", Selection(set=f"PAD_{side}"), Selection(set=f"DISC_{side}"), **about_z | changes)
        for side in ("up", "down")
    ]


def paired(points, **changes):
    """The points of both contacts."""
    return [contact_points(contact, *disc()) for contact in contacts(points, **changes)]

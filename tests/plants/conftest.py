"""Set PEND of Kroeger et al. (2008): reference numbers, and the rigs as systems in motion."""

import shutil
from pathlib import Path

import disc_with_pads
import numpy as np
import pytest
from reference import numbers

import rig
from rig.motion.motion import Motion
from rig.plants import PLANTS
from rig.plants import structure as of_matrices

DOCS = Path(__file__).parents[2] / "docs"
SCENES = {"A": "belt", "B": "belt_b", "C": "belt_c", "C_d2": "belt_c_damped"}


@pytest.fixture(scope="session")
def kroger():
    return numbers("kroger")


@pytest.fixture(scope="session")
def rigs():
    """Seal, pin, North's model and tread block of the same paper."""
    return numbers("kroger_rigs")


@pytest.fixture(scope="session")
def scenes():
    """Characteristic -> shipped scene."""
    return SCENES


def move(scene, changes=None, step_ms=1.0, duration=0.0, method=None, moved=None, **how):
    """The plant of a scene, run for `duration` s in one call; `moved`: actuators as states, as a scene would ask."""
    loaded = rig.load(scene, changes or {})
    plant = PLANTS[loaded.plant]
    assembly = plant.assemble(loaded.parameters, moved or {})
    system = assembly.system()
    chosen = method or ("exact" if system.linear else "dopri5")
    ticks = round(duration * 1e3 / step_ms)
    names = tuple(assembly.outputs)
    rows = [assembly.outputs[name].row for name in names]
    motion = Motion(system, round(step_ms * 1e6), chosen, outputs=rows, **({"longest": max(ticks, 1)} | how))
    if ticks:
        motion.advance(ticks)
    return Moved(motion, names, step_ms * 1e-3)


class Moved:
    """A motion with its outputs by name and its events in seconds, both of the last call."""

    def __init__(self, motion, names, step):
        self.motion, self.names, self.step = motion, names, step

    def __getitem__(self, name):
        values = self.motion.outputs_at(self.motion.states, self.motion.mode_sets_of_states)
        return values[:, self.names.index(name)]

    @property
    def time(self):
        """Of the record of the last call [s]."""
        count = len(self.motion.states)
        return (self.motion.tick - count + 1 + np.arange(count)) * self.step

    def times(self, what):
        return np.array([(e.tick + e.place) * self.step for e in self.motion.events() if e.what == what])

    def write(self, state, value):
        self.motion.write(self.motion.system.names.index(state), value)

    def run_up(self, start, speed, rate):
        """Move the drive from `start` to `speed` at about `rate` [m/s^2]: a jump would free a stuck mass."""
        ticks = round((speed - start) / rate * 1e3)
        self.write("drive.slope", (speed - start) / (ticks * 1e-3))
        self.motion.advance(ticks)
        self.write("drive.slope", 0.0)

    def sticks(self, settle, ticks):
        """Whether the motion still sticks in `ticks`, `settle` ticks later."""
        self.motion.advance(settle)
        self.motion.advance(ticks)
        return bool(len(self.times("contact slip ends")))


@pytest.fixture(scope="session", name="move")
def move_fixture():
    return move


@pytest.fixture(scope="module")
def disc(tmp_path_factory):
    """The folder of the disc with two pads, as CalculiX wrote it, of the page's scenes and of the reduced models."""
    folder = tmp_path_factory.mktemp("disc")
    disc_with_pads.unpacked(folder)
    for scene in DOCS.glob("disc_*.toml"):
        shutil.copy(scene, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_MODELS", str(folder / "models"))
        yield folder
    of_matrices._estimator.cache_clear()  # noqa: SLF001 (factorisations of 0.2 GB)

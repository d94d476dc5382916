"""Writes a scene as an FMU."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from rig.bench.restartable import RestartableRig
from rig.errors import UsageError
from rig.plant_fmu.description import Interface, text
from rig.scenes.scene import Scene
from rig.user_files import draft_of

_SHIM = Path(__file__).with_name("shim.c")
_COMPILER_S = 120.0


def export(scene: Scene, path: Path, inputs: Sequence[str] = (), python: str = sys.executable) -> Interface:
    """Write `scene` as the FMU `path`; returns what the FMU has.

    `inputs`: actuators that are inputs; by default all that can be commanded without new matrices. `python`: start
    value of the parameter of this name. Raises UsageError for inputs that are not possible and without a C compiler,
    OutputError.
    """
    compiler = shutil.which("gcc") or shutil.which("cc")
    if not sys.platform.startswith("linux"):
        raise UsageError("an FMU of a rig can be made on Linux only: its code starts a process of this system")
    if compiler is None:
        raise UsageError("an FMU needs a C compiler, and neither gcc nor cc is installed")
    possible, every = _possible(scene), scene.assemble().inputs
    drives = list(inputs) or possible
    faults = [f"{name:.80}: there is no such actuator" for name in drives if name not in every]
    faults += [f"{name}: each value needs new matrices" for name in drives if name in every and name not in possible]
    if faults:
        raise UsageError(f"{'; '.join(faults)}; {scene.name} has {', '.join(possible) or 'none'}")
    rig = RestartableRig(scene, drives)  # it also compiles what the FMU will need
    runner = rig.runner
    interface = Interface(
        {name: runner.inputs[name].unit for name in drives},
        dict(zip(runner.bank.names, runner.bank.units)),
        dict(runner.units),
        {name: runner.values[name] for name in drives},
    )
    identifier = re.sub(r"\W", "_", f"rig_{scene.name}")
    with tempfile.TemporaryDirectory(prefix="friction-rig-fmu-") as folder, draft_of(path) as draft:
        guid = f"{{{uuid.uuid4()}}}"
        library = _compiled(compiler, Path(folder) / f"{identifier}.so", guid, interface, scene.seed, python)
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
            described = text(scene, interface, guid, identifier, python, version("friction-rig"))
            archive.writestr("modelDescription.xml", described)
            archive.write(library, f"binaries/linux64/{identifier}.so")
            archive.writestr("resources/scene.json", scene.to_json())
            sizes = {"inputs": drives, "outputs": len(interface.results)}
            archive.writestr("resources/interface.json", json.dumps(sizes))
    return interface


def _possible(scene: Scene) -> list[str]:
    """Actuators that can be commanded without new matrices."""
    driven = replace(scene, driven=frozenset(scene.assemble().inputs)).assemble().inputs
    return [name for name, one in driven.items() if one.state or one.write]


def _compiled(compiler: str, path: Path, guid: str, interface: Interface, seed: int, python: str) -> Path:
    """Compile the shim. Raises UsageError with the message of the compiler."""
    quoted = python.replace("\\", "\\\\").replace('"', '\\"')
    given = {"GUID": f'"{guid}"', "PYTHON": f'"{quoted}"', "SEED": seed}
    given |= {"NAMES": "".join(f'"{name}",' for name in interface.inputs)}
    given |= {"INPUTS": len(interface.inputs), "OUTPUTS": len(interface.results)}
    options = [f"-D{name}={value}" for name, value in given.items()]
    command = [compiler, "-O2", "-shared", "-fPIC", *options, str(_SHIM), "-o", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_COMPILER_S)
    except subprocess.TimeoutExpired:
        raise UsageError(f"{compiler} did not finish within {_COMPILER_S:g} s") from None
    if done.returncode:
        said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip())
        raise UsageError(f"{compiler} cannot compile the FMU: {said:.300}")
    return path

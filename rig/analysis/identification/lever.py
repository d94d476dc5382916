"""The four experiments of the lever rig as cases of an identification, run with the instruments of their scenes.

free vibration     growth rate and frequency of the cylinder or of the lever: inertia and damping
static friction    the largest deflection to which a creeping disc carries the pin, at each load: mu_static
kinetic friction   the mean force of a load cell in each hold of a speed: mu_static, mu_kinetic and decay

Stiffnesses and lengths count as known (weighed, measured).
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), section 3.1, equations 22 to 30.
"""

from __future__ import annotations

from typing import Any

from rig.analysis.identification.answer import Identified
from rig.analysis.identification.identify import identify
from rig.analysis.identification.runs import LARGEST, prepared
from rig.errors import UsageError
from rig.plants.lever import Parameters
from rig.record.run import Run
from rig.scenes.scene import Scene

_RANGE = 20.0  # factor to both sides of the value of the scene in which a parameter is sought
SCENES = ("lever_free_cylinder", "lever_free_lever", "lever_static_friction", "lever_kinetic_friction")


def experiment(scene: Scene, workers: int | None = 1) -> Identified:
    """Run the experiment that a scene defines and identify its parameters. Raises UsageError for another scene."""
    from rig.bench.run.simulate import simulate

    _case(scene)
    return read(simulate(scene, {}), workers)


def read(run: Run, workers: int | None = 1) -> Identified:
    """Identify the parameters from a simulated or recorded run of such an experiment. Raises UsageError."""
    scene = Scene.from_json(run.scene_text())
    kind, output, feature, keys = _case(scene)
    sensor = next((name for name, section in scene.sensors.items() if section.reads == output), None)
    if sensor is None:
        raise UsageError(f"{scene.name}: needs a sensor that reads {output}")
    values = scene.values()
    free = {key: (values[key][0] / _RANGE, values[key][0] * _RANGE) for key in keys}
    columns: dict[str, Any] = {sensor: {"reads": output, "sensor": sensor, "feature": feature}}
    entry = {"run": run, "name": scene.name, "kind": kind, "columns": columns}
    return identify(prepared(scene, [entry], free, starts=0), workers=workers)


def _case(scene: Scene) -> tuple[str, str, str, tuple[str, ...]]:
    """Kind of the run, output that is read, its feature in a hold, and what is free. Raises UsageError."""
    p = scene.parameters
    if not isinstance(p, Parameters):
        raise UsageError(
            f"{scene.name}: no experiment identifies a {scene.plant}; give recordings: --runs FILE (docs/identify.md)"
        )
    if p.disc is None and (p.lever is None or p.cylinder.bolted):
        of, output = ("lever", "lever_displacement") if p.cylinder.bolted else ("cylinder", "arm_displacement")
        return "growth", output, "mean", (f"{of}.inertia", f"{of}.damping")
    if p.disc is not None and p.lever is None:
        if p.load_cell is None:
            return "stages", "arm_displacement", LARGEST, ("friction.mu_static",)
        if getattr(p.friction, "law", "") != "exponential":
            law = getattr(p.friction, "law", "")
            raise UsageError(f"{scene.name}: friction.law = {law!r}: only the exponential law can be fitted")
        return "stages", "cell_force", "mean", ("friction.mu_static", "friction.mu_kinetic", "friction.decay")
    raise UsageError(f"{scene.name}: is not an identification experiment; these scenes are: {', '.join(SCENES)}")

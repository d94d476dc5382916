"""A rubber buffer beside the body: a spring and a damper in series, whose force F relaxes within d/k.

    F' = k (v - F / d)      on the body: -F

Try it:   rig explain docs/example_parts.toml --measure
"""

from rig.about import About
from rig.effects import Effect
from rig.model.assembly import Output
from rig.quantities import NewtonPerMetre, quantity


class Buffer(Effect):
    """Stiffness of the spring and constant of the damper."""

    declares = About("a rubber buffer, a spring and a damper in series", hardware=True)

    stiffness: NewtonPerMetre
    damping: quantity("N*s/m")


def add(assembly, section, frame, moved):
    """Add the state F, its force on the body and an output; it acts along the sliding direction of any plant."""
    rate = {"buffer": -section.stiffness / section.damping}
    for coordinate, share in assembly.strike.items():
        rate[f"{coordinate}'"] = share * section.stiffness
        assembly.push(coordinate, {"buffer": -share})
    assembly.signal("buffer", rate, 0.0, "buffer")
    assembly.outputs["buffer_force"] = Output({"buffer": 1.0}, "N")

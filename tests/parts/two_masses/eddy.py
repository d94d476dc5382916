"""An eddy-current brake with a lag: F' = (d v - F)/tau, on the rig -F."""

from rig.effects import Effect
from rig.model.assembly import Output
from rig.quantities import quantity


class Eddy(Effect):
    """An eddy-current brake that follows with a lag."""

    constant: quantity("N*s/m") = 1.0
    lag: quantity("s") = 0.01


def add(assembly, section, frame, moved):
    """Add the state F and its force along the sliding direction."""
    rate = {"eddy": -1.0 / section.lag}
    for coordinate, share in assembly.strike.items():
        rate[f"{coordinate}'"] = share * section.constant / section.lag
        assembly.push(coordinate, {"eddy": -share})
    assembly.signal("eddy", rate, 0.0, "eddy")
    assembly.outputs["eddy_force"] = Output({"eddy": 1.0}, "N")

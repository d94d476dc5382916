"""The same problems by the programs of others, each in its best documented setting; none of them is needed here.

A function takes a step [s] or a tolerance and returns the answer. Siconos is a package of Debian for the system's own
Python: `other_python` runs this file by it.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import points

G, STEEP, SETTLED = 9.81, math.radians(20.0), 0.2
SYSTEM_PYTHON = Path(os.environ.get("SICONOS_PYTHON", "/usr/bin/python3"))
"""The Python of siconos: that of Debian, for which it is a package."""
Measured = tuple[float, float]
"""The value, and the processor time [s] of the run without preparation."""


class Other(NamedTuple):
    """A program with the problem that it answers. `setting`: what its step or tolerance is."""

    name: str
    package: str
    problem: str
    run: Callable[[float], Measured]
    steps: tuple[float, ...]
    setting: str

    def available(self) -> bool:
        """Whether it is installed here."""
        if self.package == "siconos":
            return (
                SYSTEM_PYTHON.exists()
                and not subprocess.run(
                    [SYSTEM_PYTHON, "-c", "import siconos.kernel"], capture_output=True, timeout=60, check=False
                ).returncode
            )
        return importlib.util.find_spec(self.package) is not None

    def version(self) -> str:
        """Its version."""
        if self.package == "siconos":
            asked = ["dpkg-query", "-W", "-f", "${Version}", "python3-siconos"]
            return subprocess.run(asked, capture_output=True, text=True, timeout=60, check=True).stdout
        return importlib.metadata.version({"pydrake": "drake"}.get(self.package, self.package))

    def answer(self, step: float) -> Measured:
        """Run it."""
        return other_python(self.problem, step) if self.package == "siconos" else self.run(step)


def other_python(problem: str, step: float) -> Measured:
    """The answer of siconos, by the system's Python."""
    command = [SYSTEM_PYTHON, __file__, problem, repr(step)]
    out = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True).stdout
    value, seconds = json.loads(out.splitlines()[-1])
    return value, seconds


def _mujoco(xml: str, place: int, step: float) -> Measured:
    import mujoco

    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for _ in range(round(SETTLED / step)):
        mujoco.mj_step(model, data)
    from_here, begin = float(data.qpos[place]), time.process_time()
    for _ in range(round(1.0 / step)):
        mujoco.mj_step(model, data)
    return float(data.qpos[place]) - from_here, time.process_time() - begin


def mujoco_slope(step: float, noslip: int = 0) -> Measured:
    """A box on a plane, gravity turned by the slope; elliptic cone. The creep after it has settled."""
    return _mujoco(
        f"""<mujoco><option timestep="{step}" integrator="implicitfast" cone="elliptic" noslip_iterations="{noslip}"
        gravity="{G * math.sin(STEEP)} 0 {-G * math.cos(STEEP)}"/><worldbody>
        <geom type="plane" size="10 10 1" friction="0.5 0 0"/><body pos="0 0 0.05"><freejoint/>
        <geom type="box" size="0.1 0.1 0.05" mass="1" friction="0.5 0 0"/></body></worldbody></mujoco>""",
        0,
        step,
    )


def mujoco_grip(step: float, noslip: int = 0) -> Measured:
    """A capsule between two boxes on slides, each pressed by 12 N."""
    import mujoco

    fingers = "".join(
        f'<body pos="{x} 0 0.5"><joint name="{name}" type="slide" axis="{axis} 0 0" damping="1"/>'
        '<geom type="box" size="0.01 0.03 0.03" mass="0.1" friction="0.7 0 0"/></body>'
        for name, x, axis in (("left", -0.03, 1), ("right", 0.03, -1))
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{step}" integrator="implicitfast" cone="elliptic" noslip_iterations="{noslip}"/>
        <worldbody>{fingers}<body pos="0 0 0.5"><freejoint/>
        <geom type="capsule" size="0.02 0.02" mass="0.045" friction="0.7 0 0"/></body></worldbody>
        <actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.ctrl[:] = 12.0
    for _ in range(round(SETTLED / step)):
        mujoco.mj_step(model, data)
    from_here, begin = float(data.qpos[4]), time.process_time()
    for _ in range(round(1.0 / step)):
        mujoco.mj_step(model, data)
    return from_here - float(data.qpos[4]), time.process_time() - begin


def drake_slope(step: float) -> Measured:
    """A box on four small spheres, TAMSI with the stiction tolerance 1e-6 m/s."""
    from pydrake.all import (
        CoulombFriction,
        DiagramBuilder,
        DiscreteContactApproximation,
        HalfSpace,
        MultibodyPlant,
        RigidTransform,
        SceneGraph,
        Simulator,
        SpatialInertia,
        Sphere,
    )

    builder, friction = DiagramBuilder(), CoulombFriction(0.5, 0.5)
    plant, scene = builder.AddSystem(MultibodyPlant(step)), builder.AddSystem(SceneGraph())
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kTamsi)
    plant.RegisterAsSourceForSceneGraph(scene)
    builder.Connect(plant.get_geometry_pose_output_port(), scene.get_source_pose_port(plant.get_source_id()))
    builder.Connect(scene.get_query_output_port(), plant.get_geometry_query_input_port())
    plant.mutable_gravity_field().set_gravity_vector([G * math.sin(STEEP), 0.0, -G * math.cos(STEEP)])
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "ground", friction)
    box = plant.AddRigidBody("box", SpatialInertia.SolidBoxWithMass(1.0, 0.2, 0.2, 0.1))
    for i, (x, y) in enumerate([(0.1, 0.1), (-0.1, 0.1), (0.1, -0.1), (-0.1, -0.1)]):
        plant.RegisterCollisionGeometry(box, RigidTransform([x, y, -0.04]), Sphere(0.01), f"foot {i}", friction)
    plant.set_stiction_tolerance(1e-6)
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, box, RigidTransform([0.0, 0.0, 0.05]))
    simulator.AdvanceTo(SETTLED)
    from_here, begin = float(plant.EvalBodyPoseInWorld(context, box).translation()[0]), time.process_time()
    simulator.AdvanceTo(SETTLED + 1.0)
    seconds = time.process_time() - begin
    return float(plant.EvalBodyPoseInWorld(context, box).translation()[0]) - from_here, seconds


def _exudyn(mbs: Any, seconds: float, step: float, tolerance: float, solver: Any) -> float:
    import exudyn as exu

    s = exu.SimulationSettings()
    s.timeIntegration.endTime, s.timeIntegration.numberOfSteps = seconds, round(seconds / step)
    s.timeIntegration.absoluteTolerance = s.timeIntegration.relativeTolerance = tolerance
    s.timeIntegration.verboseMode = 0
    s.solution.file.write = False
    s.solutionSettings.sensorsWritePeriod = step
    begin = time.process_time()
    exu.SolveDynamic(mbs, solverType=solver, simulationSettings=s)
    return time.process_time() - begin


def exudyn_lugre(tolerance: float) -> Measured:
    """Its own example: first-order equations by a Python function, DOPRI5."""
    import exudyn as exu
    from exudyn.itemInterface import NodeGenericODE1, ObjectGenericODE1

    mbs, s0 = exu.SystemContainer().AddSystem(), 1e5
    node = mbs.AddNode(
        NodeGenericODE1(referenceCoordinates=[0] * 3, initialCoordinates=[0] * 3, numberOfODE1Coordinates=3)
    )

    def rates(mbs: Any, t: float, item: int, q: Any) -> list[float]:
        x, v, z = q
        zt = v - z * abs(v) * s0 / (1.0 + 0.5 * math.exp(-((v / 1e-3) ** 2)))
        return [v, 2.0 * (0.1 * t - x) - (s0 * z + math.sqrt(s0) * zt + 0.4 * v), zt]

    mbs.AddObject(ObjectGenericODE1(nodeNumbers=[node], rhsUserFunction=rates))
    mbs.Assemble()
    seconds = _exudyn(mbs, 25.0, 1e-3, tolerance, exu.DynamicSolverType.DOPRI5)
    return float(mbs.GetNodeOutput(node, exu.OutputVariableType.Coordinates)[0]), seconds


def exudyn_belt(step: float) -> Measured:
    """Mass, spring and belt, friction regularised below 0.1 mm/s; the mean period of the last cycles."""
    import exudyn as exu
    import numpy as np
    from exudyn.itemInterface import (
        MarkerNodeCoordinate,
        Node1D,
        NodePointGround,
        ObjectConnectorCoordinateSpringDamper,
        ObjectConnectorCoordinateSpringDamperExt,
        ObjectMass1D,
        SensorNode,
    )

    mbs = exu.SystemContainer().AddSystem()
    node = mbs.AddNode(Node1D(referenceCoordinates=[0.0], initialVelocities=[4.0]))
    mbs.AddObject(ObjectMass1D(nodeNumber=node, physicsMass=0.5))
    ends = [
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0)),
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=0)),
    ]
    damping = 0.01 * math.sqrt(200.0)
    mbs.AddObject(ObjectConnectorCoordinateSpringDamper(markerNumbers=ends, stiffness=400.0, damping=damping))
    belt = mbs.AddNode(Node1D(referenceCoordinates=[0.0], initialVelocities=[4.0]))
    mbs.AddObject(ObjectMass1D(nodeNumber=belt, physicsMass=1e12))
    between = [mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=belt, coordinate=0)), ends[1]]
    mbs.AddObject(
        ObjectConnectorCoordinateSpringDamperExt(
            markerNumbers=between,
            fDynamicFriction=40.0,
            fStaticFrictionOffset=10.0,
            exponentialDecayStatic=0.1,
            frictionProportionalZone=1e-4,
        )
    )
    speed = mbs.AddSensor(
        SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=exu.OutputVariableType.Coordinates_t)
    )
    mbs.Assemble()
    seconds = _exudyn(mbs, 3.0, step, 1e-10, exu.DynamicSolverType.TrapezoidalIndex2)
    t, v = mbs.GetSensorStoredData(speed).T
    falls = np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))
    times = t[falls] + v[falls] * np.diff(t)[falls] / (v[falls] - v[falls + 1])
    return float(np.diff(times)[-5:].mean()), seconds


def pathsim_conveyor(tolerance: float) -> Measured:
    """Its own example with events, RKDP54, the tolerance of events as that of the steps."""
    import numpy as np
    from pathsim import Connection, Simulation
    from pathsim.blocks import ODE, Scope
    from pathsim.events import ZeroCrossing
    from pathsim.solvers import RKDP54

    m, k, d, force, v, w = 20.0, 70.0, 10.0, 1.5 * 20.0 * G, 3.0, 2.0 * math.pi / 50.0
    sign = [0]

    def rates(y: Any, u: Any, t: float) -> Any:
        if not sign[0]:
            return np.array([v * math.sin(w * t), v * w * math.cos(w * t)])
        return np.array([y[1], (sign[0] * force - k * y[0] - d * y[1]) / m])

    body = ODE(rates, np.zeros(2))

    def needed(t: float) -> float:
        return m * v * w * math.cos(w * t) + k * float(body.engine.state[0]) + d * v * math.sin(w * t)

    def guard(t: float) -> float:
        if not sign[0]:
            return force - abs(needed(t))
        return sign[0] * (v * math.sin(w * t) - float(body.engine.state[1])) + (1e-9 if t < since[0] + 1e-6 else 0.0)

    since = [0.0]

    def change(t: float) -> None:
        need = needed(t)
        body.engine.state = np.array([body.engine.state[0], v * math.sin(w * t)])
        stays = sign[0] and abs(need) <= force
        sign[0], since[0] = 0 if stays else int(math.copysign(1, need)), t

    event = ZeroCrossing(func_evt=guard, func_act=change, tolerance=1e-2 * tolerance)
    scope = Scope(sampling_period=1.0)
    world = Simulation(
        [body, scope],
        [Connection(body, scope)],
        [event],
        dt=1e-2,
        dt_max=0.1,
        Solver=RKDP54,
        tolerance_lte_rel=tolerance,
        tolerance_lte_abs=tolerance,
        log=False,
    )
    begin = time.process_time()
    world.run(100.0)
    return float(body.engine.state[0]), time.process_time() - begin


def siconos_conveyor(step: float) -> Measured:
    """In the frame of the belt: Moreau and Jean, theta 1/2, and friction by enumeration."""
    import numpy as np
    import siconos.kernel as sk
    import siconos.numerics as sn

    m, k, d, v, w = 20.0, 70.0, 10.0, 3.0, 2.0 * math.pi / 50.0
    body = sk.LagrangianLinearTIDS([0.0, 0.0], [0.0, 0.0], np.diag([m, m]), np.diag([k, 0.0]), np.diag([d, 0.0]))
    body.setFExtPtr(np.array([0.0, -m * G]))
    push = body.fExt()
    law = sk.NewtonImpactFrictionNSL(0.0, 0.0, 1.5, 2)
    relation = sk.LagrangianLinearTIR(np.array([[0.0, 1.0], [1.0, 0.0]]))
    contact = sk.Interaction(law, relation)
    world = sk.NonSmoothDynamicalSystem(0.0, 100.0)
    world.insertDynamicalSystem(body)
    world.link(contact, body)
    parts = sk.TimeDiscretisation(0.0, step), sk.MoreauJeanOSI(0.5), sk.FrictionContact(2, sn.SICONOS_FRICTION_2D_ENUM)
    stepping, begin = sk.TimeStepping(world, *parts), time.process_time()
    for i in range(round(100.0 / step)):
        t = (i + 0.5) * step
        speed, travel = v * math.sin(w * t), v / w * (1.0 - math.cos(w * t))
        push[0] = -k * travel - d * speed - m * v * w * math.cos(w * t)
        stepping.computeOneStep()
        stepping.nextStep()
    return float(body.q()[0]) + v / w * (1.0 - math.cos(w * 100.0)), time.process_time() - begin


def siconos_points(step: float) -> Measured:
    """Complementarity of gap and force for each point, theta and gamma 1/2, Lemke's method."""
    return points.siconos(step)


OTHERS = (
    Other("MuJoCo", "mujoco", "slope", mujoco_slope, (1e-3,), "step"),
    Other("MuJoCo, noslip 10", "mujoco", "slope", lambda step: mujoco_slope(step, 10), (1e-3, 1e-4), "step"),
    Other("Drake, TAMSI", "pydrake", "slope", drake_slope, (1e-3, 1e-4), "step"),
    Other("MuJoCo", "mujoco", "grip", mujoco_grip, (1e-3,), "step"),
    Other("MuJoCo, noslip 10", "mujoco", "grip", lambda step: mujoco_grip(step, 10), (1e-3, 1e-4), "step"),
    Other("PathSim", "pathsim", "conveyor", pathsim_conveyor, (1e-6, 1e-9), "tolerance"),
    Other("siconos", "siconos", "conveyor", siconos_conveyor, (1e-2, 1e-3), "step"),
    Other("siconos", "siconos", "points", siconos_points, (2e-5, 1e-4), "step"),
    Other("exudyn", "exudyn", "lugre", exudyn_lugre, (1e-8, 1e-10), "tolerance"),
    Other("exudyn", "exudyn", "belt", exudyn_belt, (1e-4, 1e-5), "step"),
)

if __name__ == "__main__":
    run = next(o.run for o in OTHERS if o.package == "siconos" and o.problem == sys.argv[1])
    sys.stdout.write(json.dumps(run(float(sys.argv[2]))) + "\n")

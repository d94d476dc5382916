"""MuJoCo: a slide joint with dry friction, relative to the belt; the coefficient is switched between steps.

MuJoCo has no static friction: `frictionloss` is regularised and creeps, and its size can only be changed by hand. A
mode change is recorded when the slip speed passes a thousandth of the belt's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rig.qualify.cost.peers.oscillator import Oscillator

NAME, PACKAGE = "MuJoCo", "mujoco"
CANNOT = "has no static friction: sticking creeps, and the coefficient is switched by hand between steps"
_STUCK = 1e-3  # of the belt's speed


def ladder() -> Iterator[tuple[str, float]]:
    """Yield the settings (method, step)."""
    return (("implicitfast", h) for h in (1e-3, 1e-4))


def prepare(o: Oscillator, setting: tuple[str, float]) -> Callable[[], list[float]]:
    """Return a function that runs once."""
    import mujoco

    method, step = setting
    friction = o.friction()
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{step}" integrator="{method}" gravity="0 0 0"/>
        <worldbody><body><joint name="x" type="slide" axis="1 0 0" frictionloss="1" solreffriction="{2 * step} 1"/>
        <geom type="sphere" size="0.01" mass="{o.mass}"/></body></worldbody></mujoco>""")

    def run() -> list[float]:
        data = mujoco.MjData(model)
        times: list[float] = []
        stuck = True
        data.qpos[0] = o.x
        for k in range(round(o.seconds / step)):
            t = k * step
            slip = float(data.qvel[0])
            x, v = float(data.qpos[0]) + o.speed * t, slip + o.speed
            now = abs(slip) < _STUCK * o.speed and (stuck or slip > -_STUCK * o.speed)
            if now != stuck:
                times.append(t)
                stuck = now
            model.dof_frictionloss[0] = o.static * o.load if stuck else friction(min(v, o.speed))
            data.qfrc_applied[0] = -o.stiffness * x - o.damping * v
            mujoco.mj_step(model, data)
        return times

    return run

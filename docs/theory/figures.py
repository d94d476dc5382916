"""Schematics of the plants on the page plants.md, as SVG files beside it: `python docs/theory/figures.py`.

Every figure is drawn from the same few parts (spring, damper, wall, body, belt). Colours are those of Okabe and Ito,
which colour-blind readers can tell apart: blue for bodies, vermilion for forces, black for the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Polygon, Rectangle

HERE = Path(__file__).parent
BODY, EDGE, FORCE, MOTION = "#cfe3f3", "#0072b2", "#d55e00", "#009e73"
Point = tuple[float, float]


def along(start: Point, end: Point, u: list[float], across: list[float]) -> tuple[list[float], list[float]]:
    """Points at shares `u` of the way from `start` to `end`, and `across` beside it."""
    a, b = np.array(start), np.array(end)
    way = b - a
    side = np.array([-way[1], way[0]]) / np.hypot(*way)
    points = a + np.outer(u, way) + np.outer(across, side)
    return list(points[:, 0]), list(points[:, 1])


def spring(ax: Axes, start: Point, end: Point, label: str = "", at: Point = (0.0, 0.28)) -> None:
    """A spring from `start` to `end`; `at`: place of the label from the middle."""
    turns = np.linspace(0.25, 0.75, 9)
    across = [0.0, 0.0, *(0.11 * (-1) ** i for i in range(7)), 0.0, 0.0]
    ax.plot(*along(start, end, [0.0, *turns, 1.0], across), color="black", lw=1.2)
    text(ax, (0.5 * (start[0] + end[0]) + at[0], 0.5 * (start[1] + end[1]) + at[1]), label)


def damper(ax: Axes, start: Point, end: Point, label: str = "", at: Point = (0.0, -0.3)) -> None:
    """A damper from `start` to `end`."""
    for u, across in (
        ([0.0, 0.4], [0.0, 0.0]),
        ([0.62, 0.4, 0.4, 0.62], [0.13, 0.13, -0.13, -0.13]),
        ([0.52, 0.52], [0.09, -0.09]),
        ([0.52, 1.0], [0.0, 0.0]),
    ):
        ax.plot(*along(start, end, u, across), color="black", lw=1.2)
    text(ax, (0.5 * (start[0] + end[0]) + at[0], 0.5 * (start[1] + end[1]) + at[1]), label)


def wall(ax: Axes, start: Point, end: Point) -> None:
    """A fixed wall; the hatching is on its left, seen from `start`."""
    ax.plot(*zip(start, end), color="black", lw=1.6)
    for u in np.linspace(0.0, 1.0, max(4, int(8 * np.hypot(end[0] - start[0], end[1] - start[1])))):
        ax.plot(*along(start, end, [u, u + 0.04], [0.0, 0.14]), color="black", lw=0.7)


def body(ax: Axes, corner: Point, width: float, height: float, label: str = "", turn: float = 0.0) -> None:
    """A rectangular body, turned about its corner by `turn` degrees."""
    ax.add_patch(Rectangle(corner, width, height, angle=turn, facecolor=BODY, edgecolor=EDGE, lw=1.4))
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    middle = 0.5 * width, 0.5 * height
    text(ax, (corner[0] + c * middle[0] - s * middle[1], corner[1] + s * middle[0] + c * middle[1]), label)


def arrow(ax: Axes, start: Point, end: Point, label: str = "", at: Point = (0.0, 0.22), color: str = MOTION) -> None:
    """An arrow with a label at its tip."""
    ax.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=11, color=color, lw=1.5))
    text(ax, (end[0] + at[0], end[1] + at[1]), label, color)


def turn(ax: Axes, centre: Point, radius: float, start: float, end: float, label: str, at: Point) -> None:
    """An arc with an arrow head, from `start` to `end` degrees."""
    angles = np.radians(np.linspace(start, end, 40))
    x, y = centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)
    ax.plot(x[:-1], y[:-1], color=MOTION, lw=1.5)
    ax.add_patch(FancyArrowPatch((x[-4], y[-4]), (x[-1], y[-1]), arrowstyle="-|>", mutation_scale=11, color=MOTION))
    text(ax, at, label, MOTION)


def text(ax: Axes, at: Point, label: str, color: str = "black") -> None:
    """A label, centred."""
    ax.text(*at, label, color=color, ha="center", va="center", fontsize=11)


def belt(ax: Axes, left: float, right: float, top: float = 0.0, label: str = "$V$") -> None:
    """A belt whose upper side moves to the right."""
    r = 0.25
    ax.plot([left, right], [top, top], color="black", lw=2)
    ax.plot([left, right], [top - 2 * r, top - 2 * r], color="black", lw=2)
    for x in (left, right):
        ax.add_patch(Circle((x, top - r), r, facecolor="white", edgecolor="black", lw=1.4))
    middle = 0.5 * (left + right)
    arrow(ax, (middle - 0.5, top - r), (middle + 0.5, top - r), label, (0.25, 0.0))


def draw_belt(ax: Axes) -> None:
    """Mass on a belt."""
    belt(ax, 0.6, 4.0)
    body(ax, (1.8, 0.0), 1.0, 0.8, "$m$")
    wall(ax, (0.0, 0.0), (0.0, 1.0))
    spring(ax, (0.0, 0.6), (1.8, 0.6), "$c$")
    damper(ax, (0.0, 0.25), (1.8, 0.25), "$d$", (-0.55, -0.02 + 0.14))
    arrow(ax, (2.3, 1.6), (2.3, 0.85), "$N_0$", (0.28, 0.5), FORCE)
    arrow(ax, (2.9, 0.45), (3.6, 0.45), "$x$", (0.18, 0.0))


def draw_pendulum(ax: Axes) -> None:
    """Pendulum on a rotating disc, seen from above."""
    ax.add_patch(Circle((0.0, 0.0), 1.5, facecolor="white", edgecolor="black", lw=1.6))
    turn(ax, (0.0, 0.0), 1.7, 200.0, 250.0, r"$\Omega$", (-1.35, -1.45))
    ax.plot([0.0, 0.9], [0.0, 0.9], color=EDGE, lw=6, solid_capstyle="round")
    ax.add_patch(Circle((0.9, 0.9), 0.16, facecolor=BODY, edgecolor=EDGE, lw=1.4))
    ax.add_patch(Circle((0.0, 0.0), 0.09, facecolor="white", edgecolor="black", lw=1.4))
    ax.plot([0.0, 1.3], [0.0, 0.0], color="black", lw=0.8, ls="--")
    turn(ax, (0.0, 0.0), 0.75, 3.0, 42.0, r"$\varphi$", (0.88, 0.32))
    text(ax, (0.3, 0.62), "$r$")
    wall(ax, (2.4, 1.7), (2.4, 0.9))
    spring(ax, (1.06, 1.0), (2.4, 1.5), r"$c_\varphi$", (0.05, 0.3))
    damper(ax, (1.06, 0.85), (2.4, 1.0), r"$d_\varphi$", (0.15, -0.28))


def draw_two_dof(ax: Axes) -> None:
    """Mass with two inclined struts on a belt."""
    belt(ax, 0.4, 3.8, -0.6)
    body(ax, (1.6, 0.0), 1.0, 0.7, "$m$")
    spring(ax, (2.1, -0.6), (2.1, 0.0), "$k_3$", (0.35, 0.0))
    wall(ax, (-0.2, 1.2), (0.3, 1.9))
    spring(ax, (1.6, 0.6), (0.1, 1.55), "$k_1, c_1$", (0.25, 0.35))
    wall(ax, (-0.2, -0.1), (-0.2, 0.7))
    spring(ax, (1.6, 0.3), (-0.2, 0.3), "$k_2, c_2$", (-0.1, -0.3))
    arrow(ax, (2.2, 1.6), (2.2, 0.75), "$F_0$", (0.28, 0.6), FORCE)
    arrow(ax, (2.9, 0.2), (3.5, 0.2), "$x$", (0.18, 0.0))
    arrow(ax, (2.9, 0.2), (2.9, 0.8), "$y$", (0.0, 0.18))


def draw_disc_slider(ax: Axes) -> None:
    """Slider on a flexible disc, from the side."""
    x = np.linspace(-0.4, 4.0, 80)
    y = -0.6 + 0.1 * np.sin(2.2 * x)
    ax.fill_between(x, y - 0.12, y + 0.0, facecolor=BODY, edgecolor=EDGE, lw=1.3)
    body(ax, (1.6, 0.2), 1.0, 0.7, "$m$")
    spring(ax, (2.1, -0.66), (2.1, 0.2), "$k_c$", (0.35, 0.0))
    wall(ax, (-0.3, 0.1), (-0.3, 0.9))
    spring(ax, (1.6, 0.5), (-0.3, 0.5), "$k_t, c_t$", (0.0, -0.3))
    wall(ax, (0.15, 1.6), (0.7, 2.1))
    spring(ax, (1.6, 0.85), (0.45, 1.85), "$k_i$", (-0.3, -0.15))
    arrow(ax, (2.3, 1.8), (2.3, 0.95), "$F_0$", (0.28, 0.6), FORCE)
    arrow(ax, (2.9, 0.3), (3.5, 0.3), "$s$", (0.18, 0.0))
    arrow(ax, (2.9, 0.3), (2.9, 0.9), "$u$", (0.0, 0.18))
    arrow(ax, (1.2, -1.0), (2.4, -1.0), r"$r_0 \Omega$", (0.35, 0.0))
    text(ax, (3.55, -0.2), "$w_d$")


def draw_lever(ax: Axes) -> None:
    """Cylinder with pin, and L-shaped lever, seen from above."""
    ax.add_patch(Circle((0.0, -1.4), 1.0, facecolor="white", edgecolor="black", lw=1.6))
    turn(ax, (0.0, -1.4), 1.15, 200.0, 245.0, r"$\Omega$", (-1.1, -2.3))
    ax.plot([0.0, 0.0], [0.6, -0.9], color=EDGE, lw=5, solid_capstyle="round")
    ax.plot([0.0, -1.2], [0.6, 0.6], color=EDGE, lw=5, solid_capstyle="round")
    ax.plot([0.0, 0.0], [0.6, 1.5], color=EDGE, lw=5, solid_capstyle="round")
    ax.add_patch(Circle((0.0, 0.6), 0.12, facecolor="white", edgecolor="black", lw=1.4))
    ax.add_patch(Circle((0.0, -0.9), 0.1, facecolor=FORCE, edgecolor="black", lw=1.0))
    text(ax, (-0.2, -0.2), "$r_2$")
    text(ax, (-0.65, 0.85), "$r_1$")
    text(ax, (0.2, 1.1), "$r_v$")
    text(ax, (-0.3, 0.32), r"$\varphi$", MOTION)
    wall(ax, (-1.6, -0.5), (-0.8, -0.5))
    spring(ax, (-1.2, 0.6), (-1.2, -0.5), "$k_1$", (-0.32, 0.0))
    ax.plot([2.1, 2.1, 1.0], [1.5, 0.0, 0.0], color=EDGE, lw=5, solid_capstyle="round", solid_joinstyle="round")
    ax.add_patch(Circle((2.1, 0.0), 0.12, facecolor="white", edgecolor="black", lw=1.4))
    spring(ax, (0.0, 1.5), (2.1, 1.5), "$k_3$")
    spring(ax, (0.05, -0.9), (1.0, 0.0), "$k_2$", (0.35, -0.15))
    text(ax, (2.35, 0.75), "$r_3$")
    text(ax, (1.55, 0.2), "$r_3$")
    text(ax, (2.42, -0.12), r"$\theta$", MOTION)


def draw_pin(ax: Axes) -> None:
    """Inclined pin on an elastic disc."""
    body(ax, (-1.3, -0.35), 2.6, 0.35, "$m_1$")
    angle = 35.0
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    ax.plot([0.0, 1.1 * c], [0.0, 1.1 * s], color=EDGE, lw=8, solid_capstyle="butt")
    text(ax, (0.3, 0.65), "$m_2$")
    near, far = (1.1 * c, 1.1 * s), (2.3 * c, 2.3 * s)
    spring(ax, near, far, "$c_2, d_2$", (-0.3, 0.35))
    wall(ax, (far[0] - 0.35 * s, far[1] + 0.35 * c), (far[0] + 0.35 * s, far[1] - 0.35 * c))
    wall(ax, (1.0, -1.4), (-1.0, -1.4))
    spring(ax, (-0.5, -1.4), (-0.5, -0.35), "$c_1$", (-0.32, 0.0))
    damper(ax, (0.5, -1.4), (0.5, -0.35), "$d_1$", (0.35, 0.0))
    turn(ax, (0.0, 0.0), 0.85, 2.0, 33.0, r"$\gamma$", (1.02, 0.22))
    arrow(ax, (-0.3, 0.2), (-1.1, 0.2), "$V$", (0.0, 0.22))
    arrow(ax, (1.0 * c + 0.35, 1.0 * s - 0.25), (1.5 * c + 0.35, 1.5 * s - 0.25), "$q$", (0.18, 0.0))
    arrow(ax, (0.0, -1.2), (0.0, -0.42), "$F$", (0.2, -0.45), FORCE)


def draw_north(ax: Axes) -> None:
    """North's model: a tilting body with a lining, pressed on a moving surface to its right."""
    body(ax, (0.0, -0.9), 0.7, 1.8, "$m, J$")
    wall(ax, (-1.4, -0.7), (-1.4, 0.7))
    spring(ax, (-1.4, 0.3), (0.0, 0.3), "$c_1$")
    damper(ax, (-1.4, -0.3), (0.0, -0.3), "$d_1$")
    spring(ax, (0.7, 0.5), (1.8, 0.5), "$c_2$", (0.0, -0.28))
    ax.plot([1.8, 1.8], [-1.1, 1.2], color="black", lw=3)
    arrow(ax, (2.1, 0.6), (2.1, -0.6), "$V$", (0.22, 0.5))
    ax.plot([0.35, 1.8], [0.0, 0.0], color="black", lw=0.6, ls="--")
    ax.annotate("", (1.15, 0.0), (1.15, 0.5), arrowprops={"arrowstyle": "<->", "lw": 0.8})
    text(ax, (0.98, 0.16), "$s$")
    ax.annotate("", (0.35, 1.1), (1.8, 1.1), arrowprops={"arrowstyle": "<->", "lw": 0.8})
    text(ax, (1.1, 1.28), "$h$")
    turn(ax, (0.35, 0.0), 0.7, 235.0, 300.0, r"$\varphi, c_\varphi, d_\varphi$", (1.25, -0.8))
    arrow(ax, (-0.9, 1.1), (-0.2, 1.1), "$x$", (0.2, 0.0))


def draw_tread(ax: Axes) -> None:
    """Tip of a tread block on a plate."""
    ax.plot([-0.6, 3.4], [-0.6, -0.6], color="black", lw=3)
    arrow(ax, (0.2, -0.85), (1.2, -0.85), "$V$", (0.25, 0.0))
    body(ax, (1.4, 0.0), 0.9, 0.6, "$m$")
    spring(ax, (1.85, -0.6), (1.85, 0.0), "$c_c$", (0.35, 0.0))
    wall(ax, (-0.4, 0.0), (-0.4, 0.7))
    spring(ax, (-0.4, 0.3), (1.4, 0.3), "$c_x, d_x$", (0.0, -0.28))
    wall(ax, (1.4, 1.8), (2.3, 1.8))
    spring(ax, (1.7, 1.8), (1.7, 0.6), "$c_z, d_z$", (-0.55, 0.0))
    ax.plot([0.5, 1.5], [0.95, 0.62], color=EDGE, lw=1.2, ls=":")
    text(ax, (0.4, 1.05), "$c_{xz}$")
    arrow(ax, (2.15, 1.45), (2.15, 0.65), "$P$", (0.22, 0.45), FORCE)
    arrow(ax, (2.6, 0.2), (3.2, 0.2), "$x$", (0.18, 0.0))
    arrow(ax, (2.6, 0.2), (2.6, 0.8), "$z$", (0.0, 0.18))


def draw_four_dof(ax: Axes) -> None:
    """Three bodies on a belt."""
    belt(ax, 1.8, 5.0, -0.6)
    body(ax, (1.2, 0.0), 0.7, 0.7, "$m_1$")
    body(ax, (3.0, 0.0), 0.9, 0.7, "$m_2$")
    body(ax, (3.05, 1.6), 0.8, 0.6, "$m_3$")
    wall(ax, (0.0, -0.1), (0.0, 0.8))
    spring(ax, (0.0, 0.35), (1.2, 0.35), "$k_1$")
    spring(ax, (1.9, 0.35), (3.0, 0.35), "$k_2$")
    spring(ax, (3.45, 0.7), (3.45, 1.6), "$k_4$", (0.35, 0.0))
    wall(ax, (3.0, 3.0), (3.9, 3.0))
    spring(ax, (3.45, 2.2), (3.45, 3.0), "$k_5$", (0.35, 0.0))
    wall(ax, (1.6, 1.5), (2.0, 2.1))
    spring(ax, (3.0, 0.65), (1.8, 1.8), "$k_3$", (0.3, 0.14))
    spring(ax, (3.45, -0.6), (3.45, 0.0), "$k_c$", (0.35, 0.0))
    arrow(ax, (4.0, 1.4), (3.75, 0.75), "$F_0$", (0.42, 0.75), FORCE)
    arrow(ax, (4.2, 0.1), (4.8, 0.1), "$u_2$", (0.2, 0.0))
    arrow(ax, (4.2, 0.1), (4.2, 0.6), "$v_2$", (0.25, 0.08))
    arrow(ax, (1.2, 0.9), (1.8, 0.9), "$u_1$", (-0.3, 0.2))
    arrow(ax, (2.8, 1.7), (2.8, 2.3), "$v_3$", (-0.22, 0.0))


def draw_plate(ax: Axes) -> None:
    """Slider with a film on a plate on foam."""
    ax.add_patch(Rectangle((-0.2, -0.8), 4.6, 0.6, facecolor="#f2f2f2", edgecolor="grey", hatch=".."))
    body(ax, (0.0, -0.2), 4.2, 0.25, "")
    wall(ax, (4.4, -0.8), (-0.2, -0.8))
    for x in np.linspace(1.15, 2.25, 7):
        spring(ax, (x, 0.05), (x, 0.42))
    body(ax, (1.0, 0.42), 1.4, 0.6, "$m$")
    arrow(ax, (1.7, 1.8), (1.7, 1.05), "$F$", (0.2, 0.5), FORCE)
    arrow(ax, (2.55, 0.7), (3.3, 0.7), "$V$", (0.2, 0.0))
    arrow(ax, (0.7, 0.55), (0.7, 1.05), "$z$", (0.0, 0.18))
    turn(ax, (1.2, 1.0), 0.35, 120.0, 50.0, r"$\theta$", (1.2, 1.52))
    for label, at in (("film", (2.65, 0.24)), ("plate", (3.7, 0.22)), ("foam", (3.7, -0.5))):
        ax.text(
            *at, label, fontsize=10, ha="center", va="center", backgroundcolor="white" if label == "foam" else "none"
        )


def beam(ax: Axes, bent: float, waves: float) -> None:
    """An inclined clamped beam over a disc; `waves`: a higher mode."""
    ax.plot([-1.2, 2.6], [0.0, 0.0], color="black", lw=3)
    arrow(ax, (-0.9, -0.25), (0.1, -0.25), "$V$", (0.25, 0.0))
    u = np.linspace(0.0, 1.0, 60)
    lean = 0.55
    straight = 0.4 + lean * u  # the tip trails: pulled along the disc it rises
    x = straight + bent * u**2 * (3 - u) / 2 + waves * np.sin(2 * np.pi * u) * u
    y = 2.2 * (1.0 - u)
    ax.plot(straight, y, color="grey", lw=1.0, ls="--")
    ax.plot(x, y, color=EDGE, lw=4)
    wall(ax, (0.0, 2.2), (0.8, 2.2))
    ax.plot([0.4, 0.4], [0.2, 2.2], color="black", lw=0.6, ls=":")
    text(ax, (0.52, 1.05), r"$\alpha$")
    arrow(ax, (1.55, 0.25), (2.2, 0.25), "$x$", (0.18, 0.0))


def draw_tip(ax: Axes) -> None:
    """Tip of a beam in one mode."""
    beam(ax, 0.35, 0.0)
    arrow(ax, (1.3, -0.85), (1.3, -0.08), "$N$", (0.25, -0.5), FORCE)


def draw_tip_beam(ax: Axes) -> None:
    """Tip of a beam in several modes."""
    beam(ax, 0.35, 0.12)
    spring(ax, (1.3, 0.0), (1.3, -0.8), "$k_c$", (0.35, 0.0))
    text(ax, (1.9, 1.2), "$q_1, q_2, ...$", MOTION)


def draw_brake(ax: Axes) -> None:
    """Disc, pads, calliper and carriers of a brake."""
    body(ax, (-1.6, -0.15), 3.2, 0.3, "disc")
    arrow(ax, (1.75, 0.0), (2.5, 0.0), r"$r \Omega$", (0.3, 0.0))
    for side, name in ((1, "outer pad"), (-1, "inner pad")):
        low = 0.5 if side > 0 else -0.95
        body(ax, (-0.7, low), 1.4, 0.45, name)
        for x in (-0.45, 0.45):
            spring(ax, (x, side * 0.15), (x, side * 0.5))
            spring(ax, (x, side * 0.95), (x, side * 1.4))
        spring(ax, (-1.7, side * 0.72), (-0.7, side * 0.72))
        body(ax, (-2.3, low), 0.6, 0.45, "")
    text(ax, (-2.0, 1.25), "free carrier")
    text(ax, (-2.0, -1.25), "supporting carrier")
    ax.add_patch(
        Polygon(
            [
                (-1.0, 1.4),
                (-1.0, 1.85),
                (3.4, 1.85),
                (3.4, -1.85),
                (-1.0, -1.85),
                (-1.0, -1.4),
                (3.0, -1.4),
                (3.0, 1.4),
            ],
            facecolor=BODY,
            edgecolor=EDGE,
            lw=1.4,
        )
    )
    text(ax, (1.0, 1.62), "calliper")
    wall(ax, (-3.2, -1.0), (-3.2, -0.4))
    spring(ax, (-3.2, -0.72), (-2.3, -0.72))
    spring(ax, (-2.0, -0.5), (-2.0, 0.5))
    text(ax, (0.85, 0.33), "$k_n$")
    arrow(ax, (2.1, 0.5), (2.6, 0.5), "$x$", (0.15, 0.0))
    arrow(ax, (2.1, 0.5), (2.1, 1.0), "$z$", (0.0, 0.16))


def draw_structure(ax: Axes) -> None:
    """A mesh with two contact points on a moving surface, pressed by a load."""
    for i in range(6):
        for j in range(3):
            ax.add_patch(Rectangle((0.5 * i, 0.9 + 0.45 * j), 0.5, 0.45, facecolor=BODY, edgecolor=EDGE, lw=0.8))
    arrow(ax, (1.5, 2.95), (1.5, 2.27), "$p\\,F$", (0.35, 0.3), FORCE)
    for x, name in ((0.5, "$k_1$"), (2.5, "$k_2$")):
        spring(ax, (x, 0.9), (x, 0.2), name, (0.33, 0.0))
    ax.plot([-0.3, 3.3], [0.2, 0.2], color="black", lw=1.6)
    arrow(ax, (1.1, -0.1), (2.1, -0.1), "$r_c W$", (0.45, 0.0))
    wall(ax, (0.0, 0.9), (0.0, 2.25))


PLANTS: dict[str, Callable[[Axes], None]] = {
    "belt": draw_belt,
    "pendulum": draw_pendulum,
    "two_dof": draw_two_dof,
    "disc_slider": draw_disc_slider,
    "lever": draw_lever,
    "pin": draw_pin,
    "north": draw_north,
    "tread": draw_tread,
    "four_dof": draw_four_dof,
    "plate": draw_plate,
    "tip": draw_tip,
    "tip_beam": draw_tip_beam,
    "brake": draw_brake,
    "structure": draw_structure,
}


def draw(folder: Path) -> None:
    """Draw every figure into `folder`. Equal versions of matplotlib write equal files."""
    plt.rcParams["svg.hashsalt"] = "plants"
    for name, figure in PLANTS.items():
        fig, ax = plt.subplots(figsize=(4.4, 3.0), layout="constrained")
        ax.set_aspect("equal")
        ax.axis("off")
        figure(ax)
        ax.margins(0.06)
        fig.savefig(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
        plt.close(fig)


if __name__ == "__main__":
    draw(HERE)

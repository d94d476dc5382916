"""The arrangement of the rerun window: picture, phase portrait and events left, curves, strips and health right.

A rig whose contact is a film of points has a map of its pressure instead of the portrait, and more curves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.view.channels import Panel
from rig.view.drawing import TIMELINE, Drawing
from rig.view.surfaces import Cells

if TYPE_CHECKING:
    import rerun.blueprint as rrb


LIVE_S = 6.0
"""Time span of the curves of a live run [s]."""
ROOM = 0.25
"""Share of the time span that is empty behind the curves: the legend is there, clear of them."""
ROOM_BESIDE = 0.6
"""The same for two plots side by side: a legend is as wide in a narrow plot."""
_DARK = (24, 27, 33)
"""The background of picture, map and portrait."""
_HEALTH = {
    "lateness": ("lateness_us", "worst_us"),
    "counts": ("late", "overruns", "drops", "held", "dropped"),
    "energy": ("energy_error",),
    "stick share": ("stick_share",),
    "rate": ("rate",),
}
"""Tabs with the curves of each."""


def blueprint(drawing: Drawing, until: float | None) -> rrb.Blueprint:
    """The window of a rig: for a live run it follows the last seconds, for a recording it shows the whole run.

    `until`: the end of the recording [s], None for a live run.
    """
    import rerun.blueprint as rrb

    second = _map(drawing) or _portrait(drawing)
    views: list[rrb.View] = [view for view in (_picture(drawing), second) if view is not None]
    views.append(_events())
    left = rrb.Vertical(*views, row_shares=[3, 3, 2.0][: len(views)])
    return rrb.Blueprint(
        rrb.Horizontal(left, _plots(drawing, until), column_shares=[2, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following" if until is None else "playing"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def time_axis(until: float | None, room: float = ROOM) -> rrb.archetypes.TimeAxis:
    """A time axis with the last seconds before the cursor, or with the whole run, and `room` for the legend behind."""
    import rerun as rr
    import rerun.blueprint as rrb

    at = rr.TimeRangeBoundary
    if until is None:
        window = rr.TimeRange(start=at.cursor_relative(seconds=-LIVE_S), end=at.cursor_relative(seconds=room * LIVE_S))
    else:
        window = rr.TimeRange(start=at.absolute(seconds=0.0), end=at.absolute(seconds=(1.0 + room) * (until or 1.0)))
    return rrb.archetypes.TimeAxis(view_range=window)


def _plots(drawing: Drawing, until: float | None) -> rrb.Vertical:
    """The first plots large, the strips below them, then the other plots as tabs; of a live run also its health."""
    import rerun.blueprint as rrb

    most = 4 if drawing.points else 2
    panels = drawing.channels.panels
    large = [_curves(panel, until) for panel in panels[:most]]
    more = _tabs_of_rest(drawing, panels[most:], until)
    strips = 1.2 if drawing.points else 2.0
    return rrb.Vertical(
        *large,
        _strips(drawing, until),
        rrb.Horizontal(_health(until), more) if until is None else more,
        row_shares=[*(6.0 / len(large) for _ in large), strips, 2.2],
    )


def _series(name: str, contents: list[str], until: float | None, room: float = ROOM) -> rrb.TimeSeriesView:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin="/",
        contents=contents,
        name=name,
        axis_x=time_axis(until, room),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
    )


def _curves(panel: Panel, until: float | None, room: float = ROOM) -> rrb.TimeSeriesView:
    paths = [f"/sensor/{name}" for name in panel.sensors] + [f"/plant/{name}" for name in panel.outputs]
    return _series(panel.title, paths, until, room)


def _tabs_of_rest(drawing: Drawing, panels: list[Panel], until: float | None) -> rrb.Tabs:
    import rerun.blueprint as rrb

    room = ROOM_BESIDE if until is None else ROOM
    views = [_curves(panel, until, room) for panel in panels]
    commands = _series("commands", ["/command/**"], until, room)  # a controller that is not in the scene may join
    tabs = [commands, *views] if drawing.controllers else [*views, commands]
    return rrb.Tabs(*tabs, active_tab=0)


def _strips(drawing: Drawing, until: float | None) -> rrb.StateTimelineView:
    import rerun.blueprint as rrb

    name = "contact, protocol, controllers" if drawing.worded else "protocol, controllers"
    return rrb.StateTimelineView(origin="/strip", name=name, time_view=time_axis(until))


def _health(until: float | None) -> rrb.Tabs:
    import rerun.blueprint as rrb

    tabs = []
    for tab, names in _HEALTH.items():
        paths = [f"/health/{name}" for name in names]
        tabs.append(_series(tab, paths, until, ROOM_BESIDE))
    return rrb.Tabs(*tabs, active_tab=0)


def _events() -> rrb.TextLogView:
    import rerun.blueprint as rrb

    columns = rrb.TextLogColumns(text_log_columns=["body"], timeline_columns=[TIMELINE])
    return rrb.TextLogView(origin="/event", name="events", columns=columns)


def _picture(drawing: Drawing) -> rrb.Spatial3DView | None:
    import rerun.blueprint as rrb

    if drawing.picture is None:
        return None
    eye = rrb.EyeControls3D(position=drawing.picture.eye, look_target=drawing.picture.target, eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin="/rig", name="the rig", eye_controls=eye, background=_DARK, line_grid=False)


def _map(drawing: Drawing) -> rrb.Spatial3DView | None:
    """The map of the film's pressure from straight above, with the front of the slider to the right."""
    import rerun.blueprint as rrb

    if drawing.picture is None or not drawing.picture.above:
        return None
    eye = rrb.EyeControls3D(position=Cells.eye, look_target=Cells.target, eye_up=(0.0, 1.0, 0.0))
    name = "pressure of the film from above; dot: its centre"
    return rrb.Spatial3DView(origin="/film", name=name, eye_controls=eye, background=_DARK, line_grid=False)


def _portrait(drawing: Drawing) -> rrb.Spatial2DView | None:
    import rerun.blueprint as rrb

    if drawing.pair is None:
        return None
    bounds = rrb.VisualBounds2D(x_range=(-1.2, 1.2), y_range=(-1.2, 1.2))
    return rrb.Spatial2DView(origin="/portrait", name="phase portrait", visual_bounds=bounds, background=_DARK)

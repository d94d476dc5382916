"""A layout for Foxglove: the plots of a rig with its curves, and the events. Lichtblick reads the same format."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from rig.record.curves import topic_of
from rig.user_files import write_file
from rig.view.channels import Panel
from rig.view.drawing import Drawing

_PLAIN = re.compile(r"[A-Za-z0-9_/-]+")
_LARGE = 6
"""Number of plots that are always visible; the others are tabs."""


def layout(drawing: Drawing) -> dict[str, Any]:
    """The layout as JSON data: plots as in rerun's window, and the log of the plant below."""
    panels = [panel for one in drawing.channels.panels for panel in _shown(drawing, one)]
    configs: dict[str, Any] = {f"Plot!p{i}": _plot(drawing, panel) for i, panel in enumerate(panels)}
    visible, hidden = list(configs)[:_LARGE], list(configs)[_LARGE:]
    if hidden:
        tabs = [{"title": panel.title, "layout": name} for panel, name in zip(panels[_LARGE:], hidden)]
        configs["Tab!more"] = {"activeTabIdx": 0, "tabs": tabs}
        visible.append("Tab!more")
    configs["RosOut!events"] = {"searchTerms": [], "minLogLevel": 1, "topicToRender": "log/plant"}
    half = -(-len(visible) // 2)
    columns = _split([side for side in (_stack(visible[:half]), _stack(visible[half:])) if side is not None], "row")
    return {
        "configById": configs,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split([columns, "RosOut!events"], "column", 80) if columns is not None else "RosOut!events",
    }


def write_layout(drawing: Drawing, path: Path) -> None:
    """Write the layout to a file. Raises rig.errors.OutputError if it cannot be written."""
    write_file(path, (json.dumps(layout(drawing), indent=1) + "\n").encode())


def _shown(drawing: Drawing, panel: Panel) -> list[Panel]:
    """A plot, without sensors in another unit than its outputs: they get their own plots."""
    channels = drawing.channels
    apart = [name for name in panel.sensors if panel.outputs and channels.measured[name].factor != 1.0]
    own = [panel._replace(title=f"{n} [{channels.sensors[n]}]", outputs=(), sensors=(n,)) for n in apart]
    return [panel._replace(sensors=tuple(name for name in panel.sensors if name not in apart)), *own]


def _plot(drawing: Drawing, panel: Panel) -> dict[str, Any]:
    channels = drawing.channels
    lines = [(name, topic_of("curve", name, channels.outputs[name]), channels.colours[name]) for name in panel.outputs]
    lines += [
        (f"{name} (measured)", topic_of("measured", name, channels.sensors[name]), channels.colour_of(name))
        for name in panel.sensors
    ]
    return {
        "foxglovePanelTitle": panel.title,
        "lichtblickPanelTitle": panel.title,
        "paths": [
            {
                "value": f"{topic if _PLAIN.fullmatch(topic) else json.dumps(topic)}.data[0]",
                "label": name.replace("_", " "),
                "color": colour,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for name, topic, colour in lines
        ],
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": False,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "yAxisLabel": panel.title,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }


def _stack(panels: list[str]) -> Any:
    """Panels above each other, of equal height."""
    if len(panels) < 2:
        return panels[0] if panels else None
    return _split([panels[0], _stack(panels[1:])], "column", round(100 / len(panels)))


def _split(parts: list[Any], direction: str, share: int = 50) -> Any:
    if len(parts) < 2:
        return parts[0] if parts else None
    return {"first": parts[0], "second": parts[1], "direction": direction, "splitPercentage": share}

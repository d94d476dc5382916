"""Studies on the page: maps, cost tables and branches, in the folders of these names, with the jobs that make new ones.

Every study has a folder of its own, as `rig map`, `rig cost` and `rig branches` write it; the page is given its figures
and tables.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rig.analysis.recorded.comparison import flattened
from rig.errors import UsageError
from rig.machine.files import DATA, contents
from rig.printable import counted
from rig.scenes.axis import Axis, axes
from rig.scenes.scene import Scene
from rig.web.catalogue import Catalogue
from rig.web.form import as_text
from rig.web.jobs import Jobs

FINISHED = {
    "maps": ("map.png", "regions.png"),
    "cost": ("cost.png",),
    "branches": ("branches.png", "curves.png"),
}
"""Folder -> the figures of which one is there when a study is finished."""
SHOWN = (".png", ".csv", ".parquet")
"""Kinds of files that the page is given."""
OF_SCENES = ("modes", "map", "regions", "cost", "branches")
"""The jobs of a scene."""
_OF_BRANCHES = ("key", "unit", "range", "output", "output_unit")
_OF_POINT = ("value", "low", "high", "stick", "stable")
_OF_SPECIAL = ("name", "value", "low", "high")
_OF_AXIS = ("key", "unit", "values")


class Studies:
    """The studies in the folders `FINISHED` of `folder`; new ones are made by `jobs`, of scenes of `catalogue`."""

    def __init__(self, folder: Path, catalogue: Catalogue, jobs: Jobs) -> None:
        self._folder = folder
        self._catalogue = catalogue
        self._jobs = jobs

    def all(self) -> list[dict[str, Any]]:
        """Of each study, the newest first: `kind` (its folder), `name`, `about`, `changed` [s], `finished`, `files`."""
        rows: list[dict[str, Any]] = []
        for kind in FINISHED:
            for folder in (self._folder / kind).glob("*"):
                if folder.is_dir():
                    rows.append(_listed(kind, folder))
        return sorted(rows, key=lambda row: -row["changed"])

    def path(self, kind: str, name: str, file: str) -> Path:
        """A file of a study of the list. Raises UsageError for anything else."""
        for row in self.all():
            if row["kind"] == kind and row["name"] == name and file in row["files"]:
                path: Path = self._folder / kind / name / file
                if path.resolve().is_relative_to(self._folder.resolve() / kind):
                    return path
        raise UsageError(f"{kind}/{name}/{file}: there is no such file; the list of the page shows them all")

    def beside(self, body: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Finished branches and maps of a scene with `changes`, the newest first, with what is drawn of them (SI)."""
        scene = self._catalogue.scene(body.get("scene"), body.get("changes"))
        values: dict[str, Any] = json.loads(scene.to_json())["parameters"]
        studies = []
        for row in self.all():
            folder = self._folder / row["kind"] / row["name"]
            try:
                study = _study_of(folder, row["kind"], scene.plant, values)
                if study is not None:
                    studies.append({"name": row["name"], **study})
            except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
                continue  # nothing of this kind, not finished, or damaged
        return studies

    def work(self, body: Mapping[str, Any]) -> dict[str, Any]:
        """Start a job: `what` (`OF_SCENES`), `scene`, `changes`, and the axes `x` and `y`, as `rig map` reads them.

        Raises SceneError for values that the scene refuses, UsageError for anything else.
        """
        what = body.get("what")
        if what not in OF_SCENES:
            raise UsageError(f"{what!r:.80}: expected {', '.join(OF_SCENES)}")
        scene = self._catalogue.scene(body.get("scene"), body.get("changes"))
        changes = body.get("changes") or {}
        options = [f"-p{key}={as_text(value, key)}" for key, value in changes.items()]
        match what:
            case "modes":
                return self._modes(scene, body, options)
            case "branches":
                return self._branches(scene, body, options)
            case "cost":
                return self._start(f"cost of {scene.name}", ["cost", *options], "cost", body)
            case _:
                return self._map(scene, body, options, by_eigenvalues=what == "regions")

    def _modes(self, scene: Scene, body: Mapping[str, Any], options: Sequence[str]) -> dict[str, Any]:
        """Start the eigenvalues of a scene; of a structure with nodes also the picture of its mode shapes."""
        title = f"eigenvalues of {scene.name}"
        given = str(body.get("scene"))
        if scene.assemble().nodes is None:
            return self._jobs.start(title, ["modes", *options, "--", given])
        shapes = self._jobs.folder() / "mode_shapes.gif"
        return self._jobs.start(title, ["modes", *options, "--shapes", str(shapes), "--", given], shapes)

    def _branches(self, scene: Scene, body: Mapping[str, Any], options: Sequence[str]) -> dict[str, Any]:
        """Start the branches of a scene over a value."""
        from rig.analysis.branches import job

        axis = job(scene, str(body.get("x") or "")).axis
        command = ["branches", *options, f"--over={body['x']}"]
        return self._start(f"branches of {scene.name} over {axis.key}", command, "branches", body)

    def _map(
        self, scene: Scene, body: Mapping[str, Any], options: Sequence[str], by_eigenvalues: bool
    ) -> dict[str, Any]:
        """Start a map of a scene over one value or two."""
        over = _axes(scene, body, by_eigenvalues)
        command = ["map", *options, *(f"{name}={text}" for name, text in over.items())]
        how = "map"
        if by_eigenvalues:
            command.append("--eigenvalues")
            how = "map by eigenvalues"
        keys = " and ".join(text.partition("=")[0] for text in over.values())
        return self._start(f"{how} of {scene.name} over {keys}", command, "maps", body)

    def _start(self, title: str, command: Sequence[str], folder: str, body: Mapping[str, Any]) -> dict[str, Any]:
        """Start a job that writes a study into one of the folders; it replaces the same study."""
        out = ["--out", str(self._folder / folder), "--force"]
        return self._jobs.start(title, [*command, *out, "--", str(body.get("scene"))])


def _listed(kind: str, folder: Path) -> dict[str, Any]:
    """The entry of a study in the list."""
    files = sorted(path.name for path in folder.iterdir() if path.suffix in SHOWN and path.is_file())
    return {
        "kind": kind,
        "name": folder.name,
        "about": _about(folder),
        "files": files,
        "changed": folder.stat().st_mtime,
        "finished": not set(FINISHED[kind]).isdisjoint(files),
    }


def _axes(scene: Scene, body: Mapping[str, Any], both: bool) -> dict[str, str]:
    """Option -> text of the axes of a map. Raises SceneError, UsageError."""
    given = {"--x": body.get("x"), "--y": body.get("y")}
    named = {name: str(text) for name, text in given.items() if text}
    if "--x" not in named or (both and "--y" not in named):
        needed = "two axes" if both else "a first axis"
        raise UsageError(f"the map needs {needed}: a value of the scene, from, to, count")
    axes(scene, named)
    return named


def _study_of(folder: Path, kind: str, plant: str, values: Mapping[str, Any]) -> dict[str, Any] | None:
    """Values and drawing of a study; None for another plant, or for other `values` than those along its axes."""
    job = json.loads(contents(folder / "job.json", DATA))
    of_study = job["scene"]["parameters"]
    varied = [axis for axis in job["axes"] if axis]
    if job["scene"]["plant"] != plant:
        return None
    if _differ(of_study, values) - {axis["key"] for axis in varied}:
        return None
    drawn = _map_of(folder, varied) if kind == "maps" else _branches_of(folder)
    return {"values": dict(flattened(of_study)), **drawn}


def _differ(values: Mapping[str, Any], others: Mapping[str, Any]) -> set[str]:
    """Keys of values in which two rigs differ; where they start is none of them."""
    first = _of_rig(values)
    second = _of_rig(others)
    return {key for key in first.keys() | second.keys() if first.get(key) != second.get(key)}


def _of_rig(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a rig without those of its start."""
    return {key: value for key, value in flattened(values) if not key.startswith("start.")}


def _branches_of(folder: Path) -> dict[str, Any]:
    """What the page draws of branches."""
    from rig.analysis.branches import FILE

    study = json.loads(contents(folder / FILE, DATA))
    lines = []
    for branch in study["branches"]:
        points = [_row(point, _OF_POINT) for point in branch["points"]]
        lines.append({"kind": branch["kind"], "points": points})
    specials = [_row(special, _OF_SPECIAL) for special in study["specials"]]
    return {**_part(study, _OF_BRANCHES), "branches": lines, "specials": specials}


def _map_of(folder: Path, axes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the page draws of a map: its axes, and for each row along x the name of the region of each point."""
    file = folder / "map.csv"
    if not file.is_file():
        file = folder / "regions.csv"
    points = csv.DictReader(contents(file, DATA).decode().splitlines())
    cells = [point["region"] if "region" in point else _region(point) for point in points]
    along_x = axes[0]["values"]
    count = len(along_x)
    drawn_axes = [_part(axis, _OF_AXIS) for axis in axes]
    return {
        "key": axes[0]["key"],
        "unit": axes[0]["unit"],
        "range": [along_x[0], along_x[-1]],
        "axes": drawn_axes,
        "regions": [cells[begin : begin + count] for begin in range(0, len(cells), count)],
    }


def _row(entries: Mapping[str, Any], names: Iterable[str]) -> list[Any]:
    return [entries[name] for name in names]


def _part(entries: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    return {name: entries[name] for name in names}


def _region(point: Mapping[str, str]) -> str:
    """The region of a point of a map by eigenvalues: of them follows only whether sliding is stable."""
    growth = float(point["growth [1/s]"])
    if point["exists"] == "0" or math.isnan(growth):
        return "?"
    return "unstable" if growth > 0.0 else "stable"


def _about(folder: Path) -> str:
    """Scene and axes of a map or of branches; the scene of a cost table; "" if that cannot be read."""
    try:
        job = json.loads(contents(folder / "job.json", DATA))
        over = "; ".join(_span(axis) for axis in job["axes"] if axis)
        how = "stable and unstable regions, " if job["settings"].get("eigenvalues") else ""
        return f"{job['scene']['title']}: {how}{over}"
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, ZeroDivisionError, RecursionError):
        return ""


def _span(entry: Mapping[str, Any]) -> str:
    """Key, ends and number of values of an axis, in words."""
    axis = Axis(entry["key"], entry["unit"], tuple(entry["values"]), entry["shown"])
    low, high = axis.shown_values[[0, -1]]
    return f"{axis.key} from {low:.4g} to {high:.4g} {axis.shown}, {counted(len(axis.values), 'value')}"

"""Lists on the page: recordings, maps and cost tables, with the jobs that make new ones.

Of the recordings of a folder jobs that check, report, export, compare and view them; maps, cost tables and branches are
those in the folders `maps`, `cost` and `branches`.

Every study has a folder of its own, as `rig map`, `rig cost` and `rig branches` write it; the page is given its figures
and tables.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rig.analysis.axis import Axis, axes
from rig.analysis.recorded.comparison import flattened
from rig.errors import UsageError
from rig.machine.files import DATA, contents
from rig.printable import counted
from rig.record.contents import SUFFIX
from rig.record.run_list import runs
from rig.scenes.scene import Scene
from rig.web.form import Catalogue, as_text
from rig.web.jobs import Jobs

OF_RECORDINGS = ("verify", "report", "csv", "compare", "view", "spectrum", "sound", "continue")


class Recordings:
    """The recordings in `folder`, and what `jobs` do with them."""

    def __init__(self, folder: Path, jobs: Jobs) -> None:
        self._folder, self._jobs = folder, jobs

    def all(self) -> list[dict[str, Any]]:
        """Name, scene, time, length, timing verdict, size and notes of each recording, the newest first."""
        rows = []
        for entry in reversed(runs(self._folder) if self._folder.is_dir() else []):
            row: dict[str, Any] = {"name": entry.path.relative_to(self._folder).as_posix(), "bytes": entry.size}
            row |= {"fault": entry.fault, "notes": [str(note) for note in entry.notes.found]}
            if (read := entry.contents) is not None:
                row |= {name: getattr(read, name) for name in ("scene", "title", "seconds", "timing", "run")}
                row["began"] = read.began_ns / 1e9
            rows.append(row)
        return rows

    def path(self, name: Any) -> Path:
        """The file of a recording of the list. Raises UsageError for anything else."""
        if isinstance(name, str) and name.endswith(SUFFIX) and "\0" not in name:
            path = self._folder / name
            if path.is_file() and path.resolve().is_relative_to(self._folder.resolve()):
                return path
        raise UsageError(f"no recording is called {name!r:.80}; the list of the page shows them all")

    def work(self, body: dict[str, Any]) -> dict[str, Any]:
        """Start a job: `what` (`OF_RECORDINGS`), `name`, for compare `other`, for continue `at` [s] and `changes`.

        Raises UsageError.
        """
        what, path = body.get("what"), self.path(body.get("name"))
        if what not in OF_RECORDINGS:
            raise UsageError(f"{what!r:.80}: expected {', '.join(OF_RECORDINGS)}")
        if what in ("verify", "view"):
            return self._jobs.start(f"{what} {path.name}", [what, str(path), *(["--web"] if what == "view" else [])])
        if what == "continue":
            at, changes = body.get("at"), body.get("changes") or {}
            if isinstance(at, bool) or not isinstance(at, int | float) or not isinstance(changes, dict):
                raise UsageError(f'"at" is {at!r:.80}; expected a time [s], and "changes" values by their keys')
            options = [f"-p{key}={as_text(value, key)}" for key, value in changes.items()]
            out = path.with_name(f"{path.stem}-from-{at:g}.mcap")
            command = ["simulate", "--from", f"{path}@{at:g}s", *options, "--out", str(out), "--force"]
            return self._jobs.start(f"{path.name} continued from {at:g} s", command)
        other = self.path(body.get("other")) if what == "compare" else path
        title, command, option, result = {
            "report": ("report of {0}", ["report", str(path)], "--out", "report.html"),
            "csv": ("tables of {0}", ["export", str(path), "--to", "csv"], "--out", f"{path.stem}-csv"),
            "spectrum": ("spectrum of {0}", ["analyse", "spectrum", str(path)], "--figure", "spectrum.png"),
            "sound": ("sound of {0}", ["analyse", "sound", str(path)], "--out", "sound.wav"),
            "compare": ("compare {0} with {1}", ["diff", str(path), str(other)], "--figure", "difference.png"),
        }[what]
        made = self._jobs.folder() / result
        return self._jobs.start(title.format(path.name, other.name), [*command, option, str(made)], made)


FINISHED = {
    "maps": ("map.png", "regions.png"),
    "cost": ("cost.png",),
    "branches": ("branches.png", "curves.png"),
}
"""Folder -> the figures of which one is there when a study is finished."""
SHOWN = (".png", ".csv", ".parquet")
OF_SCENES = ("modes", "map", "regions", "cost", "branches")


class Studies:
    """The studies in the folders `FINISHED` of `folder`; new ones are made by `jobs`, of scenes of `catalogue`."""

    def __init__(self, folder: Path, catalogue: Catalogue, jobs: Jobs) -> None:
        self._folder, self._catalogue, self._jobs = folder, catalogue, jobs

    def all(self) -> list[dict[str, Any]]:
        """Of each study, the newest first: `kind` (its folder), `name`, `about`, `changed` [s], `finished`, `files`."""
        rows: list[dict[str, Any]] = []
        for kind, last in FINISHED.items():
            for folder in filter(Path.is_dir, (self._folder / kind).glob("*")):
                files = sorted(path.name for path in folder.iterdir() if path.suffix in SHOWN and path.is_file())
                row = {"kind": kind, "name": folder.name, "about": _about(folder), "files": files}
                rows.append(row | {"changed": folder.stat().st_mtime, "finished": not set(last).isdisjoint(files)})
        return sorted(rows, key=lambda row: -row["changed"])

    def path(self, kind: str, name: str, file: str) -> Path:
        """A file of a study of the list. Raises UsageError for anything else."""
        for row in self.all():
            if (row["kind"], row["name"]) == (kind, name) and file in row["files"]:
                path: Path = self._folder / kind / name / file
                if path.resolve().is_relative_to(self._folder.resolve() / kind):
                    return path
        raise UsageError(f"{kind}/{name}/{file}: there is no such file; the list of the page shows them all")

    def beside(self, body: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Finished branches and maps of a scene with `changes`, the newest first, with what is drawn of them (SI)."""
        scene = self._catalogue.scene(body.get("scene"), body.get("changes"))
        now: dict[str, Any] = json.loads(scene.to_json())["parameters"]
        out = []
        for row in self.all():
            folder = self._folder / row["kind"] / row["name"]
            try:
                told = json.loads(contents(folder / "job.json", DATA))
                values, axes = told["scene"]["parameters"], [axis for axis in told["axes"] if axis]
                if told["scene"]["plant"] == scene.plant and not _differ(values, now) - {axis["key"] for axis in axes}:
                    drawn = _map_of(folder, axes) if row["kind"] == "maps" else _branches_of(folder)
                    out.append({"name": row["name"], "values": dict(flattened(values)), **drawn})
            except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
                continue  # nothing of this kind, not finished, or damaged
        return out

    def work(self, body: Mapping[str, Any]) -> dict[str, Any]:
        """Start a job: `what` (`WORK`), `scene`, `changes`, and the axes `x` and `y`, as `rig map` reads them.

        Raises SceneError for values that the scene refuses, UsageError for anything else.
        """
        what, given = body.get("what"), body.get("scene")
        if what not in OF_SCENES:
            raise UsageError(f"{what!r:.80}: expected {', '.join(OF_SCENES)}")
        scene = self._catalogue.scene(given, body.get("changes"))
        options = [f"-p{key}={as_text(value, key)}" for key, value in (body.get("changes") or {}).items()]
        if what == "modes":
            shapes = self._jobs.folder() / "mode_shapes.gif" if scene.assemble().nodes is not None else None
            options += ["--shapes", str(shapes)] if shapes is not None else []
            return self._jobs.start(f"eigenvalues of {scene.name}", ["modes", *options, "--", str(given)], shapes)
        if what == "branches":
            from rig.analysis.branches import job

            todo = job(scene, str(body.get("x") or ""))
            options += [f"--over={body['x']}", "--out", str(self._folder / "branches"), "--force"]
            return self._jobs.start(
                f"branches of {scene.name} over {todo.axis.key}", [what, *options, "--", str(given)]
            )
        title = f"cost of {scene.name}"
        if what != "cost":
            over = _axes(scene, body, what == "regions")
            options += [f"{name}={text}" for name, text in over.items()]
            how = "map by eigenvalues" if what == "regions" else "map"
            title = f"{how} of {scene.name} over {' and '.join(text.partition('=')[0] for text in over.values())}"
        folder = "cost" if what == "cost" else "maps"
        options += ["--eigenvalues"] if what == "regions" else []
        arguments = ["cost" if what == "cost" else "map", *options, "--out", str(self._folder / folder), "--force"]
        return self._jobs.start(title, [*arguments, "--", str(given)])


def _axes(scene: Scene, body: Mapping[str, Any], both: bool) -> dict[str, str]:
    """Option -> text of the axes of a map. Raises SceneError, UsageError."""
    given = {"--x": body.get("x"), "--y": body.get("y")}
    named = {name: str(text) for name, text in given.items() if text}
    if "--x" not in named or (both and "--y" not in named):
        raise UsageError(
            f"the map needs {'two axes' if both else 'a first axis'}: a value of the scene, from, to, count"
        )
    axes(scene, named)
    return named


def _differ(values: Mapping[str, Any], others: Mapping[str, Any]) -> set[str]:
    """Keys of values in which two rigs differ; where they start is none of them."""
    two = [{k: v for k, v in flattened(given) if not k.startswith("start.")} for given in (values, others)]
    return {key for key in two[0].keys() | two[1].keys() if two[0].get(key) != two[1].get(key)}


def _branches_of(folder: Path) -> dict[str, Any]:
    """What the page draws of branches."""
    from rig.analysis.branches import FILE

    told = json.loads(contents(folder / FILE, DATA))
    lines = [
        {
            "kind": branch["kind"],
            "points": [[p[name] for name in ("value", "low", "high", "stick", "stable")] for p in branch["points"]],
        }
        for branch in told["branches"]
    ]
    specials = [[special[name] for name in ("name", "value", "low", "high")] for special in told["specials"]]
    kept = {name: told[name] for name in ("key", "unit", "range", "output", "output_unit")}
    return {**kept, "branches": lines, "specials": specials}


def _map_of(folder: Path, axes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the page draws of a map: its axes, and for each row along x the name of the region of each point."""
    file = folder / "map.csv"
    points = csv.DictReader(contents(file if file.is_file() else folder / "regions.csv", DATA).decode().splitlines())
    cells = [row["region"] if "region" in row else _region(row) for row in points]
    count = len(axes[0]["values"])
    kept = [{name: axis[name] for name in ("key", "unit", "values")} for axis in axes]
    ends = [axes[0]["values"][0], axes[0]["values"][-1]]
    rows = [cells[i : i + count] for i in range(0, len(cells), count)]
    return {"key": kept[0]["key"], "unit": kept[0]["unit"], "range": ends, "axes": kept, "regions": rows}


def _region(row: Mapping[str, str]) -> str:
    """The region of a point of a map by eigenvalues: of them follows only whether sliding is stable."""
    growth = float(row["growth [1/s]"])
    return "?" if row["exists"] == "0" or math.isnan(growth) else "unstable" if growth > 0.0 else "stable"


def _about(folder: Path) -> str:
    """Scene and axes of a map or of branches; the scene of a cost table; "" if that cannot be read."""
    try:
        job = json.loads(contents(folder / "job.json", DATA))
        shown = [Axis(axis["key"], axis["unit"], tuple(axis["values"]), axis["shown"]) for axis in job["axes"] if axis]
        ends = [(axis, *axis.shown_values[[0, -1]]) for axis in shown]
        over = [
            f"{a.key} from {low:.4g} to {high:.4g} {a.shown}, {counted(len(a.values), 'value')}"
            for a, low, high in ends
        ]
        how = "stable and unstable regions, " if job["settings"].get("eigenvalues") else ""
        return f"{job['scene']['title']}: {how}{'; '.join(over)}"
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, ZeroDivisionError, RecursionError):
        return ""

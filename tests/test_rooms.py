"""What an installation holds, that no modules import one another in a circle, and what the locks pin."""

import os
import subprocess
import sys
import tomllib
import zipfile
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("install", ["editable", "wheel"])
def test_a_users_controllers_and_sensors_are_their_own(install, tmp_path):
    """One import name in every kind of installation: rig.controllers; `controllers` is whatever the user has."""
    own = tmp_path / "own"
    own.mkdir()
    for name in ("controllers", "sensors"):
        (own / f"{name}.py").write_text("mine = True")
    code = "import controllers, sensors, rig.controllers, rig.sensors; assert controllers.mine and sensors.mine; " + (
        "print(rig.controllers.KINDS['dither'].__module__, rig.sensors.KINDS['microphone'].__module__)"
    )
    paths = os.pathsep.join([str(own), str(_installed(install, tmp_path))])
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=own, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths}
    )
    assert found.stdout.split() == ["rig.controllers.dither", "rig.sensors.microphone"], found.stderr


def test_a_wheel_holds_the_package_alone_and_says_that_it_has_types(tmp_path):
    wheel = _installed("wheel", tmp_path)
    assert [path.name for path in wheel.iterdir() if path.suffix != ".dist-info"] == ["rig"]
    assert (wheel / "rig" / "py.typed").is_file()


def _installed(install, folder):
    """What such an installation puts on Python's path."""
    build = "build_editable" if install == "editable" else "build_wheel"
    code = f"import sys; from hatchling.build import {build}; print({build}(sys.argv[1]))"
    made = subprocess.run([sys.executable, "-c", code, str(folder)], cwd=ROOT, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    with zipfile.ZipFile(folder / made.stdout.split()[-1]) as wheel:
        wheel.extractall(folder / "site")
    links = list((folder / "site").glob("*.pth"))
    return Path(links[0].read_text().strip()) if links else folder / "site"


def test_the_links_at_the_top_are_no_second_name():
    code = "import controllers"
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, env=_environment())
    assert "are imported as rig.controllers" in found.stderr


def test_no_circle_among_modules():
    """Imports within functions and for type checkers count as well."""
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["root_packages"]
    graph = grimp.build_graph(*packages, cache_dir=None)
    try:
        TopologicalSorter({name: graph.find_modules_directly_imported_by(name) for name in graph.modules}).prepare()
    except CycleError as circle:
        pytest.fail(" imports ".join(reversed(circle.args[1])))


def _environment():
    return {**os.environ, "PYTHONPATH": str(ROOT)}

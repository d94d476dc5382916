"""A zip file for a bug report: versions, the doctor's report, the messages of the last run, and nothing of the user.

Home folder, user and host are replaced, files and folders of the user too. No scene and no recording is included.

Compilation ahead of time: every kernel shape of the shipped scenes and of the torture test.
"""

from __future__ import annotations

import compileall
import getpass
import io
import os
import platform
import re
import zipfile
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import rig
from rig import controllers, scenes, sensors
from rig.analysis.kernel_shapes import Shape, prepare
from rig.bench.live import supervise
from rig.qualify.doctor import Report
from rig.qualify.torture.cells import needed

PREFIX = "RIG_"
"""Environment variables of this project."""
_FILE = re.compile(r"[^\s'\"|,;()=<>]*\.(mcap|toml|py|png|svg|pdf|csv|json|rrd|zip|wav|rig)\b")
_FOLDER = re.compile(r"(?<![\w.])(?:~|[A-Za-z]:)?[/\\][\w.+-]+(?:[/\\][\w.+-]*)*")
_README = """A report about a problem with friction-rig, written by `rig doctor --bundle`.

versions.txt     Python, system and the packages that friction-rig uses
doctor.txt       what `rig doctor` found on this machine
environment.txt  environment variables that begin with RIG_
last_run.log     the messages of the last `rig run` or `rig demo`

USER, HOST, FILE, FOLDER and SCENE replace the names of the user, of the machine, and of files, folders and scenes.
Texts of a protocol and messages of your own parts may be in last_run.log: read it before you send it.
"""


def bundle(report: Report) -> tuple[bytes, list[str]]:
    """Return the content of the zip file with the doctor's `report`, and the names of the files in it."""
    private = {fitness.scene: "SCENE" for fitness in report.scenes if fitness.scene not in scenes.names()}
    try:
        log = supervise.path().read_text(errors="replace")
    except OSError:
        log = "no run is known: rig run and rig demo keep the messages of the last run\n"
    environment = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(PREFIX)]
    files = {
        "README.txt": _README,
        "versions.txt": "\n".join(_versions()),
        "doctor.txt": report.text(),
        "environment.txt": "\n".join(environment) or f"no variable begins with {PREFIX}",
        "last_run.log": log,
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text if text is _README else anonymous(text, private))
    return packed.getvalue(), list(files)


def anonymous(text: str, private: dict[str, str]) -> str:
    """Return `text` without home folder, user and host, files and folders of the user, and `private` names."""
    words = {platform.node(): "HOST", platform.node().partition(".")[0]: "HOST", _user(): "USER"}
    for name, instead in {str(Path.home()): "~", **private}.items():
        text = text.replace(name, instead)
    text = _FOLDER.sub("FOLDER", _FILE.sub(r"FILE.\1", text))
    for name, instead in words.items():
        if name:
            text = re.sub(rf"(?<![A-Za-z0-9]){re.escape(name)}(?![A-Za-z0-9])", instead, text)
    return text


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container without a name for its user
        return ""


def _versions() -> list[str]:
    names = ["friction-rig", *(re.split(r"[^\w-]", requirement)[0] for requirement in _required())]
    return [
        f"Python {platform.python_version()} ({platform.python_implementation()})",
        f"{platform.system()} {platform.release()} {platform.machine()}",
        *(f"{name} {_version(name)}" for name in names),
    ]


def _required() -> list[str]:
    """The packages that friction-rig needs."""
    try:
        return [requirement for requirement in requires("friction-rig") or () if "extra ==" not in requirement]
    except PackageNotFoundError:  # run from the sources without installation
        return []


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def warmup(
    report: Callable[[str], object] | None = None, names: Iterable[str] | None = None, workers: int = 1
) -> dict[Shape, float]:
    """Compile the kernels of the scenes `names`; by default of all shipped ones, and of the torture test.

    So are those of analyses with a tight tolerance (maps, branches), where they take another method than runs.
    Returns seconds for each compiled shape. `report` gets a line before and after each shape, with an estimate of the
    remaining time.
    """
    for package in (rig, controllers, sensors):  # some systems do not store bytecode: that costs 0.2 s at each start
        compileall.compile_dir(Path(package.__path__[0]), quiet=2)
    wanted = [scenes.load(name) for name in (scenes.names() if names is None else names)]
    return prepare([*wanted, *(needed() if names is None else ())], report, workers, analysed=wanted)

"""`make bench AGAINST=COMMIT`: the speed of this version over that of another, measured alternately on this machine.

The other version is unpacked from git into the user's cache, once, and compiles its own kernels there. Each case is run
for several rounds with one run of each version; the version that runs first alternates. The result is the median of the
ratios. The rounds are those of several pairs of processes: where the memory of a process lies decides a quarter of the
time of a short case, for as long as this process lives.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import platformdirs

from benchmarks.one_version import CASES
from rig.errors import UsageError
from rig.machine.files import own_folder, trusted

PAIRS = 5
"""Pairs of processes for each case."""
ROUNDS = 5
"""Rounds of a pair."""
FLOOR = 0.95
"""Smallest speed over that of the other version, for kernels; whole runs have no floor."""
ROOT = Path(__file__).resolve().parents[1]


class Version:
    """A process that runs the cases with the sources of one checkout."""

    def __init__(self, checkout: Path) -> None:
        command = [sys.executable, str(Path(__file__).with_name("one_version.py"))]
        path = os.pathsep.join([str(checkout), os.environ.get("PYTHONPATH", "")])
        self._process = subprocess.Popen(
            command,
            cwd=checkout,
            env={**os.environ, "PYTHONPATH": path},
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def round(self, case: str) -> tuple[float, str]:
        """Return processor time [s] and digest of one round; infinite and no digest if this version cannot run it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(f"{case}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            return float("inf"), ""
        spent, _, digest = self._process.stdout.readline().partition(" ")
        return (float(spent), digest.strip()) if spent else (float("inf"), "")

    def end(self) -> None:
        """End the process."""
        self._process.communicate()


def compared(there: Path) -> dict[str, dict[str, Any]]:
    """Return for each case the `speed` over that of the checkout `there`, times of both, and whether the results have
    the `same_bits`. A case that the other version cannot run has no speed.
    """
    comparisons = {}
    for case in CASES:  # processes of its own: a failure of one version ends one case only
        times, same = [], True
        for _ in range(PAIRS):
            measured, alike = _pair(case, there)
            times += measured
            same = same and alike
        comparisons[case] = _comparison(times, same)
        sys.stderr.write(f"  {case}: {comparisons[case]}\n")
    return comparisons


def _pair(case: str, there: Path) -> tuple[list[tuple[float, float]], bool]:
    """Processor times [s] of this version and of the other in a pair of new processes, and whether the bits agree."""
    versions = [Version(ROOT), Version(there)]
    for version in versions:
        version.round(case)  # compiles
    times, same = [], True
    for k in range(ROUNDS):
        order = versions if k % 2 else versions[::-1]
        measured = {version: version.round(case) for version in order}
        (ours, at), (theirs, other) = (measured[version] for version in versions)
        times.append((ours, theirs))
        same = same and at == other
    for version in versions:
        version.end()
    return times, same


def _comparison(times: list[tuple[float, float]], same: bool) -> dict[str, Any]:
    ours, theirs = (statistics.median(column) for column in zip(*times))
    if ours == float("inf"):
        return {"speed": 0.0, "fault": "this version cannot run it"}
    if theirs == float("inf"):
        return {"skipped": "the other version cannot run it"}
    speed = statistics.median(b / a for a, b in times)
    return {"speed": speed, "ms": 1e3 * ours, "ms_there": 1e3 * theirs, "same_bits": same}


def unpacked(commit: str) -> Path:
    """Return a folder with the sources of `commit`. Raises UsageError if git does not know it."""
    name = _git("rev-parse", "--verify", "--end-of-options", f"{commit}^{{commit}}").decode().strip()
    place = platformdirs.user_cache_path("friction-rig") / "versions" / name
    if not all(trusted(folder, "XDG_CACHE_HOME to another folder") for folder in (place.parent, place)):
        raise UsageError(f"--against: another user can have written the sources in {place}")
    if not place.exists():
        own_folder(place.parent)
        with (
            tempfile.TemporaryDirectory(dir=place.parent) as draft,
            zipfile.ZipFile(BytesIO(_git("archive", "--format=zip", name))) as archive,
        ):
            archive.extractall(Path(draft, name))
            Path(draft, name).rename(place)
    return place


def _git(*arguments: str) -> bytes:
    try:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, check=True).stdout
    except FileNotFoundError:
        raise UsageError("--against needs git") from None
    except subprocess.CalledProcessError as error:
        raise UsageError(f"--against: {error.stderr.decode().strip()}") from None

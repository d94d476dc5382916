"""Compiles C for tests; without a compiler these tests are skipped with a message."""

import json
import shutil
import subprocess

import pytest

from rig import controllers

NORMAL_FORCE = """
#include "rig_controller.h"
static const struct rig_signal in[] = {{"vibrometer", "%(unit)s"}};
static const struct rig_signal out[] = {{"load.force", "kg*m/s^2"}};
static const struct rig_parameter p[] = {{"gain", "N*s/m", 200, 0, 1000}, {"nominal", "N", 20, 0, 100}};
const struct rig_controller rig_controller_about = {
    %(version)s, %(size)s, 1000000, 1, 1, 2, %(states)s, in, out, p};
int rig_controller_init(const double *p, double *s) { s[0] = 0; return 0; }
int rig_controller_step(const double *p, const double *s, double *next, int64_t t, const double *in, double *out)
{
    double v = 0.5 * s[0] + 0.5 * in[0], u = p[1] - p[0] * v;
    next[0] = v;
    out[0] = u < 0 ? 0 : u > 100 ? 100 : u;
    %(more)s
    return 0;
}
"""
"""Normal-force feedback of a filtered velocity."""
SOUND = {
    "version": "RIG_CONTROLLER_VERSION",
    "size": "sizeof(struct rig_controller)",
    "states": "1",
    "unit": "m/s",
    "more": "",
}


class InPython:
    """The controller of the library, in Python."""

    reads, drives, period_ns = ("vibrometer",), ("load.force",), 1_000_000

    def start(self):
        return 0.0

    def update(self, state, t_ns, values):
        v = 0.5 * state + 0.5 * values[0]
        return v, (min(max(20.0 - 300.0 * v, 0.0), 100.0),)


def same(one, other):
    """Two runs have the bits of each other."""
    for name, samples in one.measurements.items():
        assert samples.v.tobytes() == other.measurements[name].v.tobytes()


def each_once(build, folder, suffix):
    """A function that builds variants of a controller, each once."""
    made = {}

    def make(**changes):
        key = json.dumps(changes, sort_keys=True)
        if key not in made:
            made[key] = build(folder / f"nf{len(made) if changes else ''}{suffix}", **changes)
        return made[key]

    return make


def compiled(path, source, *options):
    """The shared library `path` of the C text `source`."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed: compiled controllers are not tested")
    text = path.with_suffix(".c")
    text.write_text(source)
    command = ["gcc", "-O1", "-shared", "-fPIC", "-Wall", "-Werror", *options, str(text), "-o", str(path)]
    subprocess.run(command, check=True, timeout=60)
    return path


def controller(path, **changes):
    """The library of a controller in C: normal-force feedback with changes of its text."""
    return compiled(path, NORMAL_FORCE % (SOUND | changes), "-I", controllers.__path__[0])

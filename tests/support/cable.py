"""A second host for a test; see `benchmarks.remote`."""

import subprocess

import pytest

from benchmarks.remote import Cable


def cable_or_skip():
    """A cable to another namespace. Skips the test where none may be made."""
    try:
        return Cable()
    except (OSError, subprocess.CalledProcessError) as fault:
        pytest.skip(f"no namespace of the network may be made here: {fault}")

"""Files of a study on a disk that is full: complete or absent, and named."""

import pytest
from full_disk import largest_file

import rig as lab
from rig.errors import OutputError

OVER, MEASURE = {"load.force": [10.0]}, ["run.highest.displacement"]


def test_a_recording_that_does_not_fit_is_made_by_the_next_call(tmp_path):
    asked = {"duration": 2.0, "keep": "run.highest.displacement > 0 mm", "folder": tmp_path, "workers": 1}
    told = r"000000\.mcap cannot be written: File too large\. The values of the study are kept in .*; the same command"
    with largest_file(20_000), pytest.raises(OutputError, match=told):
        lab.study("belt", OVER, MEASURE, **asked)
    assert not [*next(tmp_path.iterdir()).joinpath("runs").iterdir()]
    found = lab.study("belt", OVER, MEASURE, **asked)
    assert lab.open(found.recordings[0]).time[-1] == 2.0


def test_a_netcdf_file_that_does_not_fit_is_told_in_a_line(tmp_path):
    found = lab.study("belt", OVER, MEASURE, duration=0.1, folder=tmp_path, workers=1)
    with largest_file(4096), pytest.raises(OutputError, match=r"new.found\.nc cannot be written: File too large$"):
        found.save(tmp_path / "new" / "found.nc")
    assert not [*(tmp_path / "new").iterdir()]

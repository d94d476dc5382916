"""Recordings on the page: listed, kept, verified, reported, compared, as jobs that can be stopped."""

import io
import shutil
import zipfile
from pathlib import Path

import pytest
from patience import wait_for

import rig
from rig.errors import UsageError
from rig.view.belt import Belt
from rig.web.jobs import Jobs

WORK = "/api/recordings/work"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two recordings."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, mu in (("one", 0.5), ("two", 0.45)):
        rig.simulate(rig.load("belt", {"friction.mu_static": mu}), duration=0.5).save(folder / f"{name}.mcap")
    return folder


@pytest.fixture
def recorded(client, folder, made):
    """The client of a server in whose folder they are."""
    shutil.copytree(made, folder / "recordings" / "runs")
    return client


def test_recordings_are_listed_and_kept_and_nothing_outside_the_folder_is_given(recorded, folder):
    runs = folder / "recordings" / "runs"
    (folder / "secret.mcap").write_text("secret")
    scenes = {row["name"]: row["scene"] for row in recorded.get("/api/recordings").json()}
    assert scenes == {"one.mcap": "belt", "two.mcap": "belt"}
    picture = recorded.post("/api/recordings/picture", name="one.mcap").json()
    assert picture == recorded.post("/api/scene", scene="belt").json()["picture"]
    kept = recorded.get("/recordings/one.mcap")
    assert kept.content == (runs / "one.mcap").read_bytes()
    assert "attachment" in kept.headers["content-disposition"]
    (runs / "link.mcap").symlink_to(folder / "secret.mcap")
    for name in ("..%2f..%2fsecret.mcap", "%2fetc%2fpasswd", "one.toml", "link.mcap", "%00.mcap"):
        refused = recorded.get(f"/recordings/{name}")
        assert refused.status_code == 422
        assert "no recording is called" in refused.json()["error"]


def test_a_recording_is_reported_exported_and_compared(recorded):
    report = recorded.job(WORK, what="report", name="one.mcap")
    page = recorded.get(f"/jobs/{report['number']}")
    assert page.text.lstrip().lower().startswith("<!doctype html>")
    assert page.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
    tables = recorded.job(WORK, what="csv", name="one.mcap")
    packed = zipfile.ZipFile(io.BytesIO(recorded.get(f"/jobs/{tables['number']}").content))
    assert any(Path(name).suffix == ".csv" for name in packed.namelist())
    compared = recorded.job(WORK, what="compare", name="one.mcap", other="two.mcap")
    assert (compared["code"], compared["result"]) == (1, ".png")
    assert any("friction.mu_static" in line for line in compared["lines"])
    spectrum = recorded.job(WORK, what="spectrum", name="one.mcap")
    assert (spectrum["code"], spectrum["result"]) == (0, ".png")
    went = recorded.job(WORK, what="continue", name="one.mcap", at=0.25, changes={"load.force": "15,5 N"})
    assert went["code"] == 0, went["lines"]
    assert "one-from-0.25.mcap" in [row["name"] for row in recorded.get("/api/recordings").json()]
    for body in (
        {"what": "continue", "name": "one.mcap", "at": "now"},
        {"what": "fly", "name": "one.mcap"},
        {"what": "compare", "name": "one.mcap"},
        {"what": "verify"},
    ):
        assert recorded.refused(WORK, **body)
    assert recorded.get("/jobs/99").status_code == 422


def test_a_recording_opens_as_a_whole(recorded, made, monkeypatch):
    """The extremes, contacts, events and pictures that the page plays are those of the recording."""
    told = recorded.post("/api/recordings/open", name="one.mcap").json()
    run = rig.open(made / "one.mcap")
    names = [output["name"] for output in told["setup"]["outputs"]]
    rows = told["frame"]["rows"]
    for name in ("displacement", "friction_force"):
        low, high = (rows[end][names.index(name)] for end in ("low", "high"))
        assert (min(low), max(high)) == pytest.approx((run.signals[name].min(), run.signals[name].max()), rel=1e-6)
    assert told["frame"]["t"] == rows["t"][-1] == pytest.approx(run.time[-1])
    assert told["frame"]["meas"].keys() == run.measurements.keys()
    assert told["setup"]["hands"]["load.force"] == "normal force"
    assert len(told["pictures"]["t"]) == len(told["pictures"]["frames"]) > 1
    assert "no recording is called" in recorded.refused("/api/recordings/open", name="other.mcap")
    monkeypatch.setattr(Belt, "frames", None)  # a drawer that fails costs the picture alone
    told = recorded.post("/api/recordings/open", name="one.mcap").json()
    assert (told["pictures"], told["setup"]["picture"]) == ({"t": [], "frames": []}, None)


def test_jobs_can_be_stopped_and_are_limited():
    jobs = Jobs()
    try:
        for _ in range(3):
            jobs.start("map", ["map", "belt", "--x", "drive.speed=0.05 m/s:0.8 m/s:4000"])
        with pytest.raises(UsageError, match="3 jobs are working"):
            jobs.start("one more", ["list"])
        jobs.job(1).stop()
        wait_for(lambda: jobs.all()[-1]["state"] == "stopped", jobs.all)
        jobs.start("list", ["list"])
    finally:
        jobs.close()
    assert not any(jobs.job(number).working for number in (1, 2, 3, 4))
    with pytest.raises(UsageError, match="there is no job"):
        jobs.job("1")

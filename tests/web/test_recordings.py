"""Recordings on the page: listed, kept, verified, reported, compared, as jobs that can be stopped."""

import io
import time
import zipfile

import pytest

import rig
from rig.errors import UsageError
from rig.web.jobs import Jobs


@pytest.fixture
def recorded(client, folder):
    """Two recordings in the folder of the server."""
    (folder / "recordings" / "runs").mkdir(parents=True)
    for name, mu in (("one", 0.5), ("two", 0.45)):
        run = rig.simulate(rig.load("belt", {"friction.mu_static": mu}), duration=0.5)
        run.save(folder / "recordings" / "runs" / f"{name}.mcap")
    return client


def test_recordings_are_listed_and_kept(recorded, folder):
    found = {one["name"]: one for one in recorded.get("/api/recordings").json()}
    assert {*found} == {"one.mcap", "two.mcap"}
    assert found["one.mcap"]["scene"] == "belt"
    kept = recorded.get("/recordings/one.mcap")
    assert kept.content == (folder / "recordings" / "runs" / "one.mcap").read_bytes()
    assert "attachment" in kept.headers["content-disposition"]


@pytest.mark.parametrize(
    "name", ["..%2f..%2fsecret.mcap", "secret.mcap", "%2fetc%2fpasswd", "one.toml", "link.mcap", "%00.mcap"]
)
def test_nothing_outside_the_folder_is_given(recorded, folder, name):
    (folder / "secret.mcap").write_text("secret")
    (folder / "recordings" / "runs" / "link.mcap").symlink_to(folder / "secret.mcap")
    found = recorded.get(f"/recordings/{name}")
    assert found.status_code == 422
    assert "no recording is called" in found.json()["error"]


def test_a_recording_is_verified_reported_exported_and_compared(recorded):
    work = "/api/recordings/work"
    verified = recorded.job(work, what="verify", name="one.mcap")
    assert verified["code"] == 0
    assert any("one.mcap: verified" in line for line in verified["lines"])
    report = recorded.job(work, what="report", name="one.mcap")
    page = recorded.get(f"/jobs/{report['number']}")
    assert page.text.lstrip().lower().startswith("<!doctype html>")
    assert page.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
    tables = recorded.job(work, what="csv", name="one.mcap")
    packed = zipfile.ZipFile(io.BytesIO(recorded.get(f"/jobs/{tables['number']}").content))
    assert any(name.endswith(".csv") for name in packed.namelist())
    compared = recorded.job(work, what="compare", name="one.mcap", other="two.mcap")
    assert (compared["code"], compared["result"]) == (1, ".png")
    assert any("friction.mu_static" in line for line in compared["lines"])
    for body in ({"what": "fly", "name": "one.mcap"}, {"what": "compare", "name": "one.mcap"}, {"what": "verify"}):
        assert recorded.post(work, **body).status_code == 422
    assert recorded.get("/jobs/99").status_code == recorded.get(f"/jobs/{verified['number']}").status_code == 422
    assert "no run is active" in recorded.post("/api/view").json()["error"]


def test_a_view_of_a_recording_tells_its_address_and_ends_when_it_is_stopped(recorded):
    number = recorded.post("/api/recordings/work", what="view", name="one.mcap").json()["number"]
    deadline, said = time.monotonic() + 60.0, []
    while not any("http://127.0.0.1:" in line for line in said):
        (job,) = recorded.get("/api/jobs").json()
        said = job["lines"]
        assert job["state"] == "working", said
        assert time.monotonic() < deadline, said
        time.sleep(0.1)
    recorded.post("/api/jobs/stop", number=number)
    (job,) = recorded.ended([number], 20.0)
    assert job["state"] == "stopped"


def test_jobs_can_be_stopped_and_are_limited():
    jobs = Jobs()
    try:
        for _ in range(3):
            jobs.start("map", ["map", "belt", "--x", "drive.speed=0.05 m/s:0.8 m/s:4000"])
        with pytest.raises(UsageError, match="3 jobs are working"):
            jobs.start("one more", ["list"])
        time.sleep(1.0)
        jobs.job(1).stop()
        assert jobs.job(1).child.wait(20.0)
        assert jobs.all()[-1]["state"] == "stopped"
        jobs.start("list", ["list"])
    finally:
        jobs.close()
    assert not any(jobs.job(number).working for number in (1, 2, 3, 4))
    with pytest.raises(UsageError, match="there is no job"):
        jobs.job("1")

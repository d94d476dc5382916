"""Maps and cost tables on the page: listed with their figures, made by jobs, and nothing beside them is given."""

import os
import time

import pytest

from rig import scenes
from rig.analysis.map import job, store_of

WORK = "/api/studies/work"
X, Y = "drive.speed=0.1:0.4 m/s:3", "load.force=10 N:20 N:2"


def test_a_map_by_eigenvalues_is_made_listed_and_shown(client, folder):
    made = client.job(WORK, what="regions", scene="belt", changes={"friction.mu_static": 0.5}, x=X, y=Y)
    assert (made["code"], made["command"]) == (0, "map"), made
    (found,) = client.get("/api/studies").json()
    assert found["finished"]
    assert {"regions.png", "regions.csv"} <= {*found["files"]}
    assert "drive.speed from 0.1 to 0.4 m/s, 3 values; load.force from 10 to 20 N, 2 values" in found["about"]
    figure = client.get(f"/studies/maps/{found['name']}/regions.png")
    assert figure.content == (folder / "maps" / found["name"] / "regions.png").read_bytes()
    assert figure.headers["content-security-policy"].startswith("sandbox")
    again = client.job(WORK, what="regions", scene="belt", changes={"friction.mu_static": 0.5}, x=X, y=Y)
    assert again["code"] == 0
    assert len(client.get("/api/studies").json()) == 1


def test_eigenvalues_are_those_of_the_changed_values(client, rig):
    made = client.job(WORK, what="modes", scene="belt", changes={"drive.speed": "80 mm/s"})
    assert made["code"] == 0, made
    _, printed, _ = rig("modes", "belt", "-p", "drive.speed=80 mm/s")
    assert [line for line in printed.splitlines() if line] == [line for line in made["lines"] if line]


def test_a_map_and_a_cost_table_are_made_to_their_end_and_shown(client):
    asked = [{"what": "map", "x": "drive.speed=0.1:0.3 m/s:2"}, {"what": "cost"}]
    numbers = [client.post(WORK, scene="belt", **one).json()["number"] for one in asked]
    jobs = client.ended(numbers, 120.0)
    assert [(job["state"], job["code"]) for job in jobs] == [("done", 0)] * 2, jobs
    found = {one["kind"]: one for one in client.get("/api/studies").json()}
    assert all(one["finished"] for one in found.values())
    for kind, files in (("maps", {"map.png", "map.csv"}), ("cost", {"cost.png", "cost.csv"})):
        assert files <= {*found[kind]["files"]}
        figure = client.get(f"/studies/{kind}/{found[kind]['name']}/{kind.removesuffix('s')}.png")
        assert figure.content.startswith(b"\x89PNG")


def test_a_cost_table_that_was_stopped_says_so_and_keeps_its_references(client, folder):
    started = client.post(WORK, what="cost", scene="belt").json()
    deadline = time.monotonic() + 60.0
    while not (kept := [*folder.glob("cost/belt-*/reference-*.json")]):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    client.post("/api/jobs/stop", number=started["number"])
    (job,) = client.ended([started["number"]], 20.0)
    assert (job["state"], job["code"]) == ("stopped", 130)
    assert any("interrupted; the results so far are in" in line for line in job["lines"])
    assert kept[0].exists()


def test_a_map_that_was_stopped_is_listed_as_unfinished(client, folder):
    started = client.post(WORK, what="map", scene="belt", x="drive.speed=0.05 m/s:0.8 m/s:2000").json()
    todo = job(scenes.load("belt"), "drive.speed=0.05 m/s:0.8 m/s:2000")
    store = store_of(todo, folder / "maps")
    deadline = time.monotonic() + 60.0
    while not [*store.folder.glob("*.npz")]:  # a folder without results is taken away
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert client.post("/api/jobs/stop", number=started["number"]).status_code == 200
    assert client.server.bench.jobs.job(started["number"]).child.wait(20.0)
    (found,) = client.get("/api/studies").json()
    assert (found["kind"], found["name"], found["finished"]) == ("maps", store.folder.name, False)


def test_damaged_folders_are_listed_without_a_description(client, folder):
    for name, text in (("a", "{"), ("b", "[]"), ("c", '{"axes": [{"key": "k", "scale": 0}]}'), ("d", "\xff")):
        (folder / "maps" / name).mkdir(parents=True)
        (folder / "maps" / name / "job.json").write_bytes(text.encode("latin1"))
    for name in ("deep", "pipe"):
        (folder / "maps" / name).mkdir()
    (folder / "maps" / "deep" / "job.json").write_text("[" * 100_000)
    os.mkfifo(folder / "maps" / "pipe" / "job.json")
    (folder / "cost" / "belt-1").mkdir(parents=True)
    (folder / "cost" / "belt-1" / "cost.png").write_bytes(b"png")
    (folder / "cost" / "file").write_text("")
    found = {f"{one['kind']}/{one['name']}": one for one in client.get("/api/studies").json()}
    assert {*found} == {*(f"maps/{name}" for name in ("a", "b", "c", "d", "deep", "pipe")), "cost/belt-1"}
    assert all(one["about"] == "" for one in found.values())
    assert [name for name, one in found.items() if one["finished"]] == ["cost/belt-1"]


@pytest.mark.parametrize(
    "path", ["maps/a/%2e%2e", "maps/a/secret.png", "maps/a/job.json", "secret/a/x.png", "maps/../x.png"]
)
def test_nothing_but_figures_and_tables_is_given(client, folder, path):
    (folder / "maps" / "a").mkdir(parents=True)
    (folder / "maps" / "a" / "job.json").write_text("{}")
    (folder / "secret.png").write_bytes(b"secret")
    (folder / "maps" / "a" / "secret.png").symlink_to(folder / "secret.png")
    assert client.get(f"/studies/{path}").status_code in (404, 422)


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ({"what": "fly", "scene": "belt"}, "'fly': expected modes, map, regions, cost"),
        ({"what": "cost", "scene": "nothing"}, "no scene is called 'nothing'"),
        ({"what": "map", "scene": "belt"}, "the map needs a first axis"),
        ({"what": "regions", "scene": "belt", "x": X}, "the map needs two axes"),
        ({"what": "map", "scene": "belt", "x": "drive.sped=1:2:3"}, "did you mean drive.speed"),
        ({"what": "cost", "scene": "belt", "changes": {"load.force": -1}}, "must be at least 0 N"),
    ],
)
def test_what_cannot_be_computed_is_refused_before_a_job_starts(client, body, told):
    answer = client.post(WORK, **body)
    assert answer.status_code == 422
    assert told in answer.json()["error"]
    assert client.get("/api/jobs").json() == []

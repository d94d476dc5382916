"""Maps and cost tables on the page: listed with their figures, made by jobs, and nothing beside them is given."""

from patience import wait_for

from rig import scenes
from rig.analysis.map import job, store_of

WORK = "/api/studies/work"
X, Y = "drive.speed=0.1:0.4 m/s:3", "load.force=10 N:20 N:2"


def test_a_map_by_eigenvalues_is_made_listed_and_shown(client, folder):
    made = client.job(WORK, what="regions", scene="belt", changes={"friction.mu_static": 0.5}, x=X, y=Y)
    assert (made["code"], made["command"]) == (0, "map"), made
    (row,) = client.get("/api/studies").json()
    assert row["finished"]
    assert {"regions.png", "regions.csv"} <= {*row["files"]}
    assert "drive.speed from 0.1 to 0.4 m/s, 3 values; load.force from 10 to 20 N, 2 values" in row["about"]
    figure = client.get(f"/studies/maps/{row['name']}/regions.png")
    assert figure.content == (folder / "maps" / row["name"] / "regions.png").read_bytes()
    assert figure.headers["content-security-policy"].startswith("sandbox")
    (beside,) = client.post("/api/studies/beside", scene="belt", changes={"drive.speed": 0.3}).json()
    assert beside["regions"] == [["unstable", "stable", "stable"]] * 2  # at 0.1, 0.25, 0.4 m/s
    assert [(axis["key"], len(axis["values"])) for axis in beside["axes"]] == [("drive.speed", 3), ("load.force", 2)]
    assert client.post("/api/studies/beside", scene="belt", changes={"body.damping": 3.0}).json() == []


def test_eigenvalues_are_those_of_the_changed_values(client, rig):
    made = client.job(WORK, what="modes", scene="belt", changes={"drive.speed": "80 mm/s"})
    assert made["code"] == 0, made
    _, printed, _ = rig("modes", "belt", "-p", "drive.speed=80 mm/s")
    assert [line for line in printed.splitlines() if line] == [line for line in made["lines"] if line]


def test_branches_are_those_of_the_chosen_values(client):
    over = "drive.speed=0.1 m/s:0.8 m/s"
    made = client.job(WORK, what="branches", scene="belt", changes={"load.force": "15 N"}, x=over)
    assert made["code"] == 0, made
    (row,) = client.get("/api/studies").json()
    assert (row["kind"], row["finished"]) == ("branches", True)
    assert "drive.speed from 0.1 to 0.8 m/s" in row["about"]
    (found,) = client.post("/api/studies/beside", scene="belt", changes={"load.force": 15.0, "drive.speed": 0.3}).json()
    assert {name for name, *_ in found["specials"]} >= {"Hopf point", "grazing fold (contact)"}
    assert {branch["kind"] for branch in found["branches"]} == {"sliding", "cycles"}
    assert (found["key"], found["output"], found["values"]["load.force"]) == ("drive.speed", "displacement", 15.0)
    assert client.post("/api/studies/beside", scene="belt", changes={}).json() == []
    assert client.post("/api/studies/beside", scene="belt_c", changes={"load.force": 15.0}).json() == []
    assert "the ends are the same" in client.refused(WORK, what="branches", scene="belt", x="drive.speed=1:1")


def test_a_map_that_was_stopped_is_listed_as_unfinished(client, folder):
    number = client.post(WORK, what="map", scene="belt", x="drive.speed=0.05 m/s:0.8 m/s:9000").json()["number"]
    store = store_of(job(scenes.load("belt"), "drive.speed=0.05 m/s:0.8 m/s:9000"), folder / "maps")
    wait_for(lambda: [*store.folder.glob("*.npz")])  # a folder without results is taken away
    client.post("/api/jobs/stop", number=number)
    client.ended([number])
    (row,) = client.get("/api/studies").json()
    assert (row["kind"], row["name"], row["finished"]) == ("maps", store.folder.name, False)


def test_nothing_but_figures_and_tables_is_given(client, folder):
    (folder / "maps" / "a").mkdir(parents=True)
    (folder / "maps" / "a" / "job.json").write_text("{}")
    (folder / "secret.png").write_bytes(b"secret")
    (folder / "maps" / "a" / "secret.png").symlink_to(folder / "secret.png")
    for path in ("maps/a/%2e%2e", "maps/a/secret.png", "maps/a/job.json", "secret/a/x.png"):
        assert client.get(f"/studies/{path}").status_code in (404, 422)


def test_what_cannot_be_computed_is_refused_before_a_job_starts(client):
    for body, told in (
        ({"what": "fly", "scene": "belt"}, "'fly': expected modes, map, regions, cost, branches"),
        ({"what": "cost", "scene": "nothing"}, "no scene is called 'nothing'"),
        ({"what": "map", "scene": "belt"}, "the map needs a first axis"),
        ({"what": "regions", "scene": "belt", "x": X}, "the map needs two axes"),
        ({"what": "map", "scene": "belt", "x": "drive.sped=1:2:3"}, "did you mean drive.speed"),
        ({"what": "cost", "scene": "belt", "changes": {"load.force": -1}}, "must be at least 0 N"),
    ):
        assert told in client.refused(WORK, **body)
    assert client.get("/api/jobs").json() == []

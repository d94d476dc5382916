"""Files of contact rows: units, and what is refused with file and line; a number of modes that cannot be."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from disc_with_pads import disc, paired

import rig
from rig import scenes
from rig.errors import SceneError, UsageError
from rig.structure import plausible
from rig.structure.basis import Reduction, build
from rig.structure.rows import contact_rows
from rig.structure.stated import Contact


@pytest.fixture
def nodes():
    """A node of the upper pad and the node of the disc below it."""
    _, mesh = disc()
    pad = int(mesh.sets["PAD_UP"][0])
    below = mesh.sets["DISC_UP"]
    away = np.linalg.norm(mesh.xyz[mesh.at(below)] - mesh.xyz[mesh.at(np.array([pad]))], axis=1)
    return pad, int(below[away.argmin()])


def lines(pad, disc_node, area="1e-4", **changed):
    """The lines of one point; `changed` by their number from 2 on."""
    rows = ["point,what,node,direction,value", f"1,normal,{pad},z,1", f"1,normal,{disc_node},z,-1"]
    rows += [f"1,along,{pad},y,1", f"1,along,{disc_node},y,-1", f"1,area,,,{area}", "1,radius,,,0.1"]
    for number, line in changed.items():
        rows[int(number[1:]) - 1] = line
    return "\n".join(rows)


def test_areas_and_radii_are_in_the_units_of_the_matrices(tmp_path, nodes):
    path = tmp_path / "rows.csv"
    path.write_text(lines(*nodes))
    metres = contact_rows("up", path, disc()[0])
    path.write_text(lines(*nodes, area="100", l7="1,radius,,,100"))
    millimetres = contact_rows("up", path, disc()[0], 1e-3)
    assert millimetres.area == pytest.approx(metres.area)
    assert millimetres.radius == pytest.approx(metres.radius)
    assert abs(millimetres.normal - metres.normal).max() == 0.0


def test_a_file_states_its_nodes_its_area_and_the_gap(tmp_path, nodes):
    path = tmp_path / "rows.csv"
    path.write_text(lines(*nodes))
    met = contact_rows("up", path, disc()[0]).met
    assert (met.nodes, met.offered, met.met, met.slaves) == (1, None, 1e-4, frozenset(nodes[:1]))
    assert met.gap == pytest.approx(0.0, abs=1e-12)
    ground = lines(*nodes, l3="", l5="")
    path.write_text(ground)
    assert contact_rows("up", path, disc()[0]).met.gap is None


def test_a_file_states_its_nodes_and_its_area_without_a_mesh(tmp_path, nodes):
    path = tmp_path / "rows.csv"
    path.write_text(lines(*nodes))
    bare = replace(disc()[0], ids=np.zeros(0, dtype=np.int64), xyz=np.zeros((0, 3)), faces=np.zeros((0, 4), np.int32))
    contact = Contact(1, contact_rows("up", path, bare).met)
    assert contact.text == "1 point; 1 slave node; area 0.0001 m^2 as its rows give it; gap not known without a mesh"
    path.write_text(lines(*nodes, l3="", l5=""))
    assert contact_rows("up", path, bare).met.gap is None
    path.write_text(lines(*nodes, l2=f"1,normal,{nodes[0]},z,0.5"))
    [(what, _)] = contact_rows("up", path, bare).met.doubts
    assert "line 2: the normal of point 1 has the length 0.5" in what


def test_a_file_may_have_semicolons_as_the_other_files_of_a_structure(tmp_path, nodes):
    path = tmp_path / "rows.csv"
    path.write_text(lines(*nodes).replace(",", ";"))
    assert contact_rows("up", path, disc()[0]).area.tolist() == [1e-4]


def test_an_area_in_another_unit_is_doubted(tmp_path, nodes):
    """Square metres in a file of millimetres."""
    path = tmp_path / "rows.csv"
    path.write_text(lines(*nodes))
    [(what, remedy)] = contact_rows("up", path, disc()[0], 1e-3).met.doubts
    assert what.startswith("contacts.up: its rows give an area of 1e-10 m^2; the surface of the mesh is 0.1")
    assert "structure.units" in remedy
    assert contact_rows("up", path, disc()[0]).met.doubts == ()


def test_directions_of_another_length_are_doubted(tmp_path, nodes):
    pad, below = nodes
    path = tmp_path / "rows.csv"
    path.write_text(lines(pad, below, l4=f"1,along,{pad},y,3", l5=f"1,along,{below},y,-3"))
    [(what, remedy)] = contact_rows("up", path, disc()[0]).met.doubts
    assert what.startswith("contacts.up: rows.csv, line 4: the along of point 1 has the length 3; displacements")
    assert remedy == "give directions of length 1 (1 point with another one)"
    slanted = {"l2": f"1,normal,{pad},z,0.6", "l3": f"1,normal,{below},z,-0.6\n1,normal,{pad},x,0.8"}
    path.write_text(lines(pad, below, **slanted) + f"\n1,normal,{below},x,-0.8")
    assert contact_rows("up", path, disc()[0]).met.doubts == ()


@pytest.mark.parametrize("first", [0, 1])
def test_a_normal_that_points_out_of_the_slave_is_doubted(tmp_path, nodes, first):
    """The pad lies on the disc; slave is the first node, and the normal points into it."""
    slave, master = nodes if first == 0 else nodes[::-1]
    path = tmp_path / "rows.csv"
    inwards, outwards = ("1", "-1") if first == 0 else ("-1", "1")
    path.write_text(lines(slave, master, l2=f"1,normal,{slave},z,{inwards}", l3=f"1,normal,{master},z,{outwards}"))
    assert contact_rows("up", path, disc()[0]).met.doubts == ()
    path.write_text(lines(slave, master, l2=f"1,normal,{slave},z,{outwards}", l3=f"1,normal,{master},z,{inwards}"))
    [(what, remedy)] = contact_rows("up", path, disc()[0]).met.doubts
    assert what.startswith("contacts.up: rows.csv, line 2: the normal of point 1 points out of its slave")
    assert "change the signs (1 point like this)" in remedy


BAD = [
    ({"l3": "1,normal,99999,z,-1"}, "line 3: node 99999 is not in the mesh"),
    ({"l3": "1,normal,1,z,-1"}, "line 3: the matrices have no row of 1 z"),
    ({"l3": "1,normal,500,,-1"}, "line 3: node 500 needs a direction"),
    ({"l4": "1,along,{pad},z,1", "l5": "1,along,{below},z,-1"}, "line 4: the sliding of point 1 points along its norm"),
    ({"l2": "1,normal,{pad},z,0", "l3": "1,normal,{below},z,0"}, "line 2: the normal of point 1 is zero"),
    ({"area": "1e-14"}, "line 6: the area of point 1 is 1e-14 m.2, but the surface of the mesh is 0.1.* m.2"),
    ({"area": "100"}, "line 6: the area of point 1 is 100 m.2, but the surface of the mesh is .* structure.units"),
    ({"l6": "1,area,{pad},z,1e-4"}, "line 6: area belongs to point 1, not to node"),
    ({"l6": ""}, "line 2: point 1 has no area"),
    ({"l3": "1,normal,{below},z,-0.7"}, "line 2: point 1: a displacement of the whole structure by 1 m opens its gap"),
]


@pytest.mark.parametrize(("changed", "fault"), BAD)
def test_rows_that_cannot_be_are_refused_with_file_and_line(tmp_path, nodes, changed, fault):
    pad, below = nodes
    given = {key: text.format(pad=pad, below=below) for key, text in changed.items()}
    path = tmp_path / "rows.csv"
    path.write_text(lines(pad, below, **given))
    with pytest.raises(SceneError) as refusal:
        contact_rows("up", path, disc()[0])
    assert re.search(f"rows.csv, {fault}", "\n".join(refusal.value.faults))


SCENE = """
format = 1
title = "two masses"
plant = "structure"
[structure]
units = "{units}"
nodes = "./nodes.csv"
rows = "./order.csv"
[structure.parts.M]
of = "mass"
file = "./M.mtx"
[structure.parts.K]
of = "stiffness"
file = "./K.mtx"
[reduction]
kind = "{kind}"
modes = {modes}
[contacts.pad]
rows = "./contact.csv"
stiffness = "1e10 N/m^3"
[drive]
speed = "0.1 m/s"
[load]
force = "10 N"
at = {{ top = {{ node = 2, direction = "{pull}" }} }}
[friction]
law = "constant"
mu = 0.3
"""


def written(folder, units, kind="whole", modes=2, upper=((1e5, 0, 5e4), (0, 2e5, 0), (5e4, 0, 3e5)), pull="-z"):
    """Two nodes above each other with three rows each, in m, kg or in mm, t.

    `upper`: the stiffness that holds the upper node [N/m]; `pull`: the direction of its load.
    """
    length = {"m-kg-s": 1.0, "mm-t-s": 1e-3}[units]
    folder.mkdir()
    scipy.io.mmwrite(folder / "M.mtx", scipy.sparse.coo_array(np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]) * length))
    stiffness = np.diag([4e5, 5e5, 6e5, 0.0, 0.0, 0.0])
    stiffness[0, 2] = stiffness[2, 0] = 5e4
    stiffness[3:, 3:] = upper
    scipy.io.mmwrite(folder / "K.mtx", scipy.sparse.coo_array(stiffness * length), symmetry="general")
    (folder / "nodes.csv").write_text(f"node,x,y,z\n1,0,0,0\n2,0,0,{0.1 / length}\n")
    order = [f"{node},{direction}" for node in (1, 2) for direction in "xyz"]
    (folder / "order.csv").write_text("\n".join(["node,direction", *order]))
    (folder / "contact.csv").write_text(
        f"1,normal,2,z,1\n1,normal,1,z,-1\n1,along,2,x,1\n1,along,1,x,-1\n1,area,,,{1e-4 / length**2}\n"
    )
    (folder / "scene.toml").write_text(SCENE.format(units=units, kind=kind, modes=modes, pull=pull))
    return scenes.load(folder / "scene.toml")


def test_a_scene_in_millimetres_is_the_scene_in_metres(tmp_path):
    metres = rig.modes(written(tmp_path / "m", "m-kg-s"))
    millimetres = rig.modes(written(tmp_path / "mm", "mm-t-s"))
    assert len(metres.sliding.modes) == 6
    for one, other in zip(metres.sliding.modes, millimetres.sliding.modes, strict=True):
        assert other.frequency == pytest.approx(one.frequency, rel=1e-9)
    assert millimetres.stated.contacts["pad"].met.met == pytest.approx(1e-4)
    assert "1 point; 1 slave node; area 0.0001 m^2 as its rows give it; largest gap 0.1 m" in millimetres.text()
    assert millimetres.stated.total == pytest.approx(1.5)


def test_a_body_that_nothing_holds_is_named(tmp_path):
    """The upper node is held by the contact alone, and the load pulls it away."""
    scene = written(tmp_path / "loose", "m-kg-s", upper=np.diag([1e5, 2e5, 0.0]), pull="z")
    [finding] = [finding for finding in rig.modes(scene).findings if "no contact presses" in finding.what]
    assert finding.what == "no contact presses, and no spring holds body of node 2"


def test_more_modes_than_rows_are_refused_at_once(tmp_path):
    full, _ = disc()
    began = time.monotonic()
    with pytest.raises(UsageError, match=rf"reduction\.modes is 20000 and the matrices have {full.rows} rows"):
        build(full, Reduction(modes=20000, at={}))
    assert time.monotonic() - began < 1.0
    with pytest.raises(SceneError, match=r"reduction\.modes is 7 and the matrices have 6 rows"):
        written(tmp_path / "few", "m-kg-s", "modes", 7)


def test_a_structure_that_cannot_be_reduced_says_what_may_be_wrong_with_it(tmp_path, monkeypatch):
    """Wrong units of an elastic modulus put thousands of modes below every frequency."""
    monkeypatch.setattr(plausible, "_unlike_material", lambda full: iter([("strange stiffness", "look at the units")]))
    with pytest.raises(SceneError) as refusal:
        written(tmp_path / "few", "m-kg-s", "modes", 7)
    assert refusal.value.faults[1] == "strange stiffness; look at the units"


def test_the_points_of_the_disc_have_the_areas_that_their_file_gives(tmp_path):
    [up, _] = paired((1, 1))
    normal = up.normal.tocoo()
    full, _ = disc()
    rows = []
    for what, entries in (("normal", normal), ("along", up.along.tocoo())):
        for k, v in zip(entries.coords[1].tolist(), entries.data.tolist()):
            rows.append(f"1,{what},{full.node[k]},{'xyz'[full.direction[k]]},{v!r}")
    rows.sort(key=lambda line: -int(line.split(",")[2]))  # the pad has the higher numbers
    path = tmp_path / "rows.csv"
    path.write_text("\n".join([*rows, f"1,area,,,{float(up.area[0])!r}"]))
    met = contact_rows("up", path, full).met
    assert met.nodes == 45
    assert met.met == pytest.approx(up.met.met)
    assert met.gap == pytest.approx(up.met.gap, abs=1e-12)

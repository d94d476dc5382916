"""What is stated of a structure: its mass, how much of a contact meets, what may be wrong, and which bodies move."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from disc_with_pads import contacts, disc, paired
from skfem.helpers import dot
from skfem.models import elasticity

from rig.structure import plausible
from rig.structure.basis import Reduction, build
from rig.structure.contacts import Contact, contact_points
from rig.structure.full import Full, Part
from rig.structure.mesh import NOTHING, Selection
from rig.structure.reduced import Reduced
from rig.structure.stated import Stated

SECTOR = 0.5 * np.sin(2.0 * np.pi / 60.0)
"""Area of the triangle between the axis and an edge of the disc, over the square of its radius."""
PAD = 8 * SECTOR * (0.118**2 - 0.080**2)
"""Area of the face of a pad [m^2]."""


def moved(rise, beyond):
    """The mesh with the nodes of the face of the upper pad raised where their radius is larger than `beyond` [m]."""
    _, mesh = disc()
    xyz = mesh.xyz.copy()
    at = mesh.at(mesh.sets["PAD_UP"])
    xyz[at, 2] += np.where(np.hypot(*xyz[at, :2].T) > beyond, rise, 0.0)
    return replace(mesh, xyz=xyz)


def body(name):
    """The nodes of a body of the disc with pads."""
    full, mesh = disc()
    rows = plausible.regions(full, mesh)[name]
    return tuple(np.intersect1d(full.node[rows], mesh.ids).tolist())


def test_a_contact_states_what_meets():
    [up, _] = paired((4, 6))
    assert up.met.nodes == up.met.pairs == 45
    assert up.met.offered == pytest.approx(PAD)
    assert up.met.met == pytest.approx(PAD)
    assert (up.met.gap, up.met.asked, up.met.doubts) == (pytest.approx(0.0, abs=1e-12), 24, ())


def test_area_beyond_the_search_is_stated_and_doubted():
    """Inner rings of nodes at 80, 89.5 and 99 mm meet; those at 108.5 and 118 mm are 1.5 mm away."""
    full, _ = disc()
    far = contact_points(contacts((4, 6))[0], full, moved(1.5e-3, 0.1))
    assert (far.met.nodes, far.met.pairs) == (45, 27)
    radii = np.array([0.080, 0.0895, 0.099])
    inner = 8 * SECTOR * (radii[-1] ** 2 - radii[0] ** 2)
    # Of the faces that rise, three of four triangles are within 1 mm, and their inner nodes keep their shares
    next_ring = 8 * SECTOR * (0.1085**2 - radii[-1] ** 2)
    assert inner < far.met.met < inner + 0.75 * next_ring
    assert far.met.met == pytest.approx(far.area.sum())
    assert far.met.offered > PAD  # the faces that rise are larger
    [(what, remedy)] = far.met.doubts
    lost = far.met.offered - far.met.met
    assert f"{lost:.3g} m^2 of its slave take no part" in what
    assert "0.0015" in what
    assert "beyond search = 0.001 m" in what
    assert "raise contacts.pad_up.search" in remedy
    near = contact_points(replace(contacts((4, 6))[0], search=1.6e-3), full, moved(1.5e-3, 0.1))
    assert (near.met.pairs, near.met.doubts) == (45, ())
    assert near.met.met == pytest.approx(near.met.offered)
    assert near.met.gap == pytest.approx(1.5e-3)


def test_bodies_that_overlap_beyond_the_search_are_doubted():
    far = contact_points(contacts((4, 6))[0], disc()[0], moved(-1.5e-3, 0.1))
    assert far.met.pairs == 27
    assert "beyond search" in far.met.doubts[0][0]


@pytest.mark.parametrize("both", [False, True])
def test_sides_and_backs_of_a_pad_do_not_face_the_disc(both):
    full, mesh = disc()
    pads = body("body of PAD_UP") + body("body of PAD_DOWN") * both
    slave = Selection(nodes=pads)
    described = Contact("pads", slave, Selection(nodes=body("IRON")), "face", axis=(0.0, 0.0, 1.0))
    points = contact_points(described, full, mesh)
    assert points.met.doubts == ()
    assert points.met.met == pytest.approx((1 + both) * PAD)
    assert points.met.offered > 2.0 * points.met.met


def test_contacts_that_share_nodes_are_doubted():
    full, _ = disc()
    up, down = paired((2, 2))
    assert plausible.doubts(replace(full, contacts=(up, down))) == ()
    [(what, _)] = plausible.doubts(replace(full, contacts=(up, down, replace(up, name="again"))))
    assert "contacts.pad_up and contacts.again share 45 slave nodes" in what
    assert "two springs act at the same area" in what


def test_contacts_that_adjoin_have_nodes_but_no_area_in_common():
    """Both halves of a pad have the nodes of the line between them."""
    full, mesh = disc()
    [described, _] = contacts(None)
    nodes = mesh.sets["PAD_UP"]
    angle = np.arctan2(*mesh.xyz[mesh.at(nodes)].T[1::-1])
    middle = np.median(np.unique(angle.round(9)))
    halves = []
    for name, chosen in (("left", angle < middle + 1e-6), ("right", angle > middle - 1e-6)):
        half = replace(described, name=name, slave=Selection(nodes=tuple(nodes[chosen].tolist())))
        halves.append(contact_points(half, full, mesh))
    [(what, _)] = plausible.doubts(replace(full, contacts=tuple(halves)))
    assert "contacts.left and contacts.right share 5 slave nodes" in what
    assert "their faces adjoin there; no area has two springs" in what
    assert halves[0].met.met + halves[1].met.met == pytest.approx(PAD)


def test_a_contact_the_other_way_round_is_doubted():
    full, mesh = disc()
    [described, _] = contacts(None)
    there = contact_points(described, full, mesh)
    back = contact_points(replace(described, name="back", slave=described.master, master=described.slave), full, mesh)
    [(what, remedy)] = plausible.doubts(replace(full, contacts=(there, back)))
    assert "contacts.pad_up and contacts.back join the same two faces" in what
    assert "leave one of the contacts out" in remedy


def scaled(stiffness, mass):
    """The disc with stiffness and mass times these numbers."""
    full, _ = disc()
    parts = [replace(part, factor=stiffness if part.of == "stiffness" else mass) for part in full.parts]
    return replace(full, parts=tuple(parts))


def test_the_speed_of_sound_is_that_of_the_materials():
    """Cast iron has 4000 m/s, the lining less."""
    assert 1000.0 < plausible.speed_of_sound(disc()[0]) < 8000.0
    assert plausible.doubts(disc()[0]) == ()


@pytest.mark.parametrize(("stiffness", "mass"), [(1e-6, 1.0), (1e6, 1.0), (1.0, 1e-3), (1.0, 1e-12)])
def test_a_speed_of_sound_of_no_material_is_doubted(stiffness, mass):
    """An elastic modulus in MPa or in uPa; a density in g/cm^3 or in t/mm^3."""
    [(what, remedy)] = plausible.doubts(scaled(stiffness, mass))
    assert "speed of sound of about" in what
    assert "units" in remedy


def test_the_total_mass_is_that_of_the_bodies_that_move():
    outer = 60 * SECTOR * (0.125**2 - 0.072**2) * 0.012 * 7100.0
    # Elements at the held bore: the square of a motion that grows from 0 to 1 along the radius
    inner = 60 * SECTOR * (0.072**2 - 0.060**2) * 0.012 * 7100.0 * (0.060 / 3 + 0.012 / 4) / 0.066
    pads = 2 * 8 * SECTOR * (0.118**2 - 0.080**2) * (0.010 * 2500.0 + 0.005 * 7850.0)
    assert plausible.total_mass(disc()[0]) == pytest.approx(outer + inner + pads, rel=1e-9)


def test_bodies_have_the_names_of_their_sets():
    full, mesh = disc()
    regions = plausible.regions(full, mesh)
    assert list(regions) == ["IRON", "body of PAD_UP", "body of PAD_DOWN"]
    assert sum(map(len, regions.values())) == full.rows
    bare = plausible.regions(full, replace(mesh, sets={}, groups={}))
    assert list(bare) == [f"body of node {min(body(name))}" for name in regions]
    assert list(plausible.regions(full, NOTHING)) == list(bare)  # rows have numbers of nodes without a mesh too
    joined = full.parts[0].matrix.tolil()
    first = [int(rows[0]) for rows in regions.values()]
    for i, j in ((0, 1), (1, 2)):
        joined[first[i], first[j]] = joined[first[j], first[i]] = 1.0
    one = replace(full, parts=(replace(full.parts[0], matrix=joined.tocsr()), *full.parts[1:]))
    [alone] = plausible.regions(one, replace(mesh, sets={}, groups={}))
    assert alone == f"body of node {min(map(min, map(body, regions)))}"
    of_sets = plausible.regions(one, mesh)
    assert next(iter(of_sets)) == "IRON"
    assert {"LINING", "STEEL"} <= of_sets.keys()


def test_shares_of_bodies_are_those_of_the_full_matrices_and_are_stored():
    full, mesh = disc()
    regions = plausible.regions(full, mesh)
    total = plausible.total_mass(full)
    sides = tuple(paired((2, 2)))
    at = {side.stiffness_key: 1e11 for side in sides}
    whole = replace(full, contacts=sides, regions=regions, total=total, doubts=(("odd", "look"),))
    reduced = Reduced.from_bytes(build(whole, Reduction(modes=20, at=at)).to_bytes())
    stated = Stated.of(reduced)
    assert stated.total == total
    assert stated.doubts == (("odd", "look"),)
    assert stated.contacts["pad_up"].met == sides[0].met
    names = [f"q{i}" for i in range(1, reduced.coordinates + 1)]
    amplitudes = np.arange(1.0, len(names) + 1.0) * np.exp(1j * np.arange(len(names)))
    shares = stated.shares(dict(zip(names, amplitudes.tolist())), {}, names)
    moved_rows = reduced.basis.astype(float) @ amplitudes
    mass = full.matrix("mass", {})
    kinetic = (moved_rows.conj() @ (mass @ moved_rows)).real
    assert list(shares.values()) == sorted(shares.values(), reverse=True)
    for name, rows in regions.items():
        of_region = moved_rows[rows]
        expected = (of_region.conj() @ (mass[rows][:, rows] @ of_region)).real / kinetic
        assert shares[name] == pytest.approx(expected, abs=1e-5)  # the basis is stored in single precision


def test_a_model_of_an_earlier_version_states_nothing():
    sides = tuple(paired((1, 1)))
    at = {side.stiffness_key: 1e11 for side in sides}
    content = build(replace(disc()[0], contacts=sides, total=1.0), Reduction(modes=2, at=at)).to_bytes()
    with np.load(io.BytesIO(content)) as file:
        arrays = dict(file)
    head = json.loads(arrays["head"].tobytes())
    for key in ("met", "total", "doubts", "masses"):
        del head[key]
    arrays["head"] = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
    earlier = io.BytesIO()
    np.savez(earlier, **arrays)
    stated = Stated.of(Reduced.from_bytes(earlier.getvalue()))
    assert [*stated.lines(), *stated.warnings()] == []
    assert stated.shares({"q1": 1.0}, {"q1": 1.0}, ("q1", "q2")) == {}


def test_the_share_of_a_network_stays_beside_those_of_bodies():
    mass = np.diag([1.0, 4.0])
    stated = Stated(None, {}, (), {"a": np.diag([1.0, 0.0]), "b": np.diag([0.0, 4.0])}, mass)
    shape = {"x": 1.0 + 0.0j, "y": 0.5j, "charge": 2.0}
    shares = stated.shares(shape, {"x": 0.3, "y": 0.3, "charge": 0.4}, ("x", "y", "x'", "y'", "charge"))
    assert shares == pytest.approx({"charge": 0.4, "a": 0.3, "b": 0.3})
    assert stated.shares({"charge": 1.0}, {"charge": 1.0}, ("x", "y", "charge")) == {}


ELEMENTS = {
    "C3D8": (skfem.MeshHex, skfem.ElementHex1),
    "C3D27": (skfem.MeshHex, skfem.ElementHex2),
    "C3D4": (skfem.MeshTet, skfem.ElementTetP1),
    "C3D10": (skfem.MeshTet, skfem.ElementTetP2),
}


@pytest.mark.parametrize("kind", ELEMENTS)
@pytest.mark.parametrize("size", [(0.1, 0.1, 0.1), (0.1, 0.1, 0.002), (0.1, 0.001, 0.002)])
@pytest.mark.parametrize(("young", "poisson", "density"), [(2.1e11, 0.3, 7850.0), (2e6, 0.49, 1100.0)])
def test_the_speed_of_sound_hardly_depends_on_elements_and_sizes(kind, size, young, poisson, density):
    """Cubes, sheets and bars of steel and of rubber, 3 x 4 x 2 elements: within a factor of three."""
    mesh_type, element = ELEMENTS[kind]
    mesh = mesh_type.init_tensor(*(np.linspace(0.0, side, count) for side, count in zip(size, (4, 5, 3))))
    basis = skfem.Basis(mesh, skfem.ElementVector(element()), intorder=4)  # exact for these shapes
    stiffness = elasticity.linear_elasticity(*elasticity.lame_parameters(young, poisson)).assemble(basis)
    mass = density * skfem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    places = basis.doflocs.T
    _, node = np.unique(np.round(places / 1e-6), axis=0, return_inverse=True)
    order = np.argsort(node, kind="stable")
    direction = np.zeros(len(node), dtype=np.int64)
    direction[order] = np.arange(len(node)) % 3
    xyz = np.zeros((node.max() + 1, 3))
    xyz[node] = places
    parts = (Part("M", "mass", sp.csr_array(mass)), Part("K", "stiffness", sp.csr_array(stiffness)))
    full = Full(parts, node + 1, direction, ids=np.arange(1, len(xyz) + 1), xyz=xyz)
    longitudinal = np.sqrt(young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson)) / density)
    assert 1.0 / 3.0 < plausible.speed_of_sound(full) / longitudinal < 3.0

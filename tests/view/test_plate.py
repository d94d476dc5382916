"""The plate rig as one sees it: picture, pressure map, figure."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

import rig
from rig.bus import encode, messages
from rig.bus.run_setup import Setup
from rig.bus.topics import Message
from rig.plants.structures import film_slider
from rig.record import statistics
from rig.record.film_points import Points
from rig.record.run import Run
from rig.view import contact, pressure
from rig.view.drawing import Drawing
from rig.view.feed import Feed
from rig.view.palette import put

FILM = {"film.along": "5", "film.across": "4"}


@pytest.fixture(scope="module")
def scene():
    return rig.load("plate", FILM)


@pytest.fixture(scope="module")
def units(scene):
    return {name: output.unit for name, output in scene.assemble().outputs.items()}


@pytest.fixture(scope="module")
def run(scene, units):
    """Made up: loaded within 0.1 s, open at some points from 0.3 s on, and wandering from edge to edge."""
    time = np.arange(0.0, 0.5, 1e-3)
    signals = {name: np.zeros(time.size) for name in units}
    points = scene.parameters.film_points
    lean = np.where(time >= 0.3, 2.0 * np.sin(200.0 * time), 0.2)
    shape = 1.0 + lean[:, None] * points.x / points.x[-1]
    pressed = 1e5 * np.minimum(time / 0.1, 1.0)[:, None] * np.maximum(shape, 0.0)
    signals |= {name: pressed[:, k // points.across] for k, name in enumerate(points.names)}
    total = pressed.sum(axis=1)
    centre = np.divide(pressed @ points.x, total, out=np.zeros_like(total), where=total > 0.0)
    area = points.length * points.width / points.along
    signals |= {"contact_fraction": (pressed > 0.0).mean(axis=1), "pressure_centre_x": centre}
    signals |= {"normal_force": area * total, "position": 0.01 * time, "surface_speed": 0.01 + 0.0 * time}
    signals |= {"slider_displacement": -8e-8 + 1e-8 * lean, "pitch_displacement": 1e-6 * lean}
    opens = (pressed[1:] == 0.0) & (pressed[:-1] > 0.0)
    signals["openings"][1:] = np.cumsum(opens.sum(axis=1))
    return Run(scene.to_json(), 1_000_000, 1_000_000, time, signals, units, mode=np.zeros(time.size, np.int64))


def column(columns, path, component):
    """Values that a frame list gives an entity, by frame."""
    found = next(one for one in columns if one.path == path and component in one.columns.fields)
    return np.array(found.columns.fields[component]).reshape(len(found.t_ns), -1, 3).squeeze()


def test_pressures_are_where_the_film_has_its_points(scene, run):
    points, film = scene.parameters.film_points, scene.assemble().film
    at = film_slider.places(points, film)
    assert list(at) == list(points.names)
    x, y = np.meshgrid(points.x, points.y, indexing="ij")
    order = list(at.values())
    assert film.x[order] == pytest.approx(x.ravel(), abs=1e-12)
    assert film.y[order] == pytest.approx(y.ravel(), abs=1e-12)
    (surface,) = Points.of(scene).surfaces
    assert surface.x == pytest.approx(x, abs=1e-12)
    assert surface.y == pytest.approx(y, abs=1e-12)
    maps = surface.maps(run.signals)
    assert maps.shape == (run.time.size, 5, 4)
    assert np.array_equal(maps[400, 2, 3], run.signals["pressure_3_4"][400])


def test_instants_that_tell_most_are_found_after_the_load_is_on(run):
    found = {instant.why: run.time[instant.sample] for instant in statistics.characteristic(run)}
    opening = run.time[statistics.first_open(run)]
    assert opening == pytest.approx(run.time[(run.time >= 0.3) & (run.signals["contact_fraction"] < 1.0)][0])
    assert found["first opening"] == opening
    assert 0.2 < found["before the first opening"] < opening
    sample = dict(zip(found, (round(1e3 * t) for t in found.values())))
    assert run.signals["pressure_centre_x"][sample["most at the rear edge"]] < -0.005
    assert run.signals["pressure_centre_x"][sample["most at the front edge"]] > 0.005
    assert run.signals["contact_fraction"][sample["fewest in contact"]] == run.signals["contact_fraction"][200:].min()


def test_the_slider_travels_as_it_does_and_its_motion_is_magnified(scene, run, units):
    drawing = Drawing(scene.to_json(), units, {})
    picture = drawing.picture
    t_ns = np.round(run.time * 1e9).astype(np.int64)
    shown = np.arange(0, t_ns.size, 10)
    columns = picture.frames(t_ns, run.signals, run.mode, shown)
    place = column(columns, "rig/slider", "translation")
    assert np.ptp(place[:, 0]) == pytest.approx(0.01 * run.time[shown[-1]] / 0.05, rel=1e-5)
    heave = run.signals["slider_displacement"][shown]
    assert np.diff(place[:, 2]) == pytest.approx(picture.scale.motion / 0.05 * np.diff(heave), abs=1e-6)
    assert 0.01 < np.abs(heave).max() * picture.scale.motion / 0.05 < 0.3
    colours = column(columns, "film/map", "vertex_colors")
    opened = (colours == contact.rgb(pressure.OPEN)).all(axis=2).mean(axis=1)
    assert opened == pytest.approx(1.0 - run.signals["contact_fraction"][shown])
    assert np.array_equal(colours, column(columns, "rig/film", "vertex_colors"))


def test_a_live_film_is_a_map_and_no_curve_for_each_point(scene, run, units):
    drawing = Drawing(scene.to_json(), units, {})
    feed = Feed(drawing, Setup("r", scene.to_json(), 1_000_000, 20_000, units, {}))
    encoder = encode.StateEncoder(len(units))
    state = messages.state_type(list(units))
    for k in range(0, run.time.size, 5):
        values = np.array([run.signals[name][k] for name in units])
        payload = bytes(encoder(k * 1_000_000, k, 0, values))
        feed.add([Message("state", payload, k, k * 1_000_000, said=state.FromString(payload))])
        ends, ones, extremes = np.array([(k + 1) * 1_000_000]), np.ones(1, np.int64), values[None]
        content = (ends, extremes, extremes, ones, ones * 0, 20_000, np.empty(0), np.empty(0, np.int64))
        payload = encode.band(k, k * 1_000_000, *content)
        said = messages.TYPES["Band"].FromString(payload)
        feed.add([Message("band", payload, k, k * 1_000_000, said=said)])
    paths = [one.path for one in feed.take()]
    assert {"rig/film", "film/map", "film/centre", "plant/contact_fraction"} <= set(paths)
    assert not [path for path in paths if path.startswith("plant/pressure_1")]


@pytest.mark.parametrize("kind", ["film", "bonded"])
def test_any_run_of_the_plate_becomes_a_figure(kind, run, tmp_path):
    keep = {
        "film": lambda name: True,
        "bonded": lambda name: not name.startswith(("pressure", "contact", "openings")),
    }[kind]
    put(replace(run, signals={name: v for name, v in run.signals.items() if keep(name)}).plot(), tmp_path / "run.png")
    picture = imread(tmp_path / "run.png")
    assert picture.shape[1] == 1600
    violet = np.abs(picture[..., :3] - pressure.table()[0] / 255.0).max(axis=2) < 0.1
    assert (violet.mean() > 1e-4) == (kind == "film")

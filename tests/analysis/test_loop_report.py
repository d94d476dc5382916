"""Control loops over poor links: jump linear systems against constant delays, random links and simulations."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rig
from rig.analysis.linear import loop_check, loop_report
from rig.analysis.linear.control_loop import loop
from rig.analysis.linear.jump_linear import ages, jump_growth, mean_age
from rig.analysis.linear.loop_report import report
from rig.bus.impaired_link import HeardSensor
from rig.cli.app import program
from rig.errors import SceneError
from rig.scenes.network import Link, Network
from rig.view.palette import put

MS = 1_000_000


def link(**values):
    return Link().model_copy(update=values)


@pytest.fixture(scope="module")
def belt():
    return rig.load("belt_normal_force")


def test_ages_are_those_of_a_link():
    one = link(delay=4 * MS, jitter=3 * MS)
    heard, seen = HeardSensor(one.made("meas/v", 1, MS)), np.zeros(20)
    for tick in range(10_000):
        heard.tick(tick, [float(tick)])
        if tick > 20:
            seen[int(tick - heard.latest)] += 1
    expected = dict(ages(one, MS))
    assert seen[1:8] / seen.sum() == pytest.approx([expected.get(age, 0.0) for age in range(1, 8)], abs=0.015)
    assert mean_age(link(delay=4 * MS, jitter=3 * MS, reorder=True), MS) < mean_age(one, MS)


@settings(max_examples=5)
@given(st.integers(0, 25), st.integers(0, 25))
def test_constant_delays_are_those_of_the_loop(belt, heard, commanded):
    found = jump_growth(belt, "nf", link(delay=heard * MS), link(delay=commanded * MS))
    assert found.mean_square == pytest.approx(loop(belt, "nf", (heard + commanded) * MS).growth, rel=1e-6)
    assert found.mean == pytest.approx(found.mean_square, rel=1e-6)


def test_a_held_command_is_a_held_measurement_for_a_controller_without_memory(belt):
    lossy = link(loss=0.6)
    one, other = jump_growth(belt, "nf", lossy, Link()), jump_growth(belt, "nf", Link(), lossy)
    assert one.mean_square == pytest.approx(other.mean_square, rel=1e-8)
    assert one.mean_square > one.mean  # Jensen


@pytest.mark.parametrize(
    ("about", "runs", "error"),
    [({"delay": 12 * MS}, 1, 1e-3), ({"delay": 20 * MS, "jitter": 8 * MS, "loss": 0.3}, 4, 0.05)],
)
def test_computed_decay_is_that_of_simulations(belt, monkeypatch, about, runs, error):
    monkeypatch.setattr(loop_check, "RUNS", runs)
    one = link(**about)
    computed = jump_growth(belt, "nf", one, Link())
    network = Network(meas={"vibrometer": one})
    found = loop_check.simulated(belt, "nf", network, computed.mean_square, computed)
    assert found.growth == pytest.approx(computed.mean_square, rel=error)


def test_the_report_of_a_scene_with_links(monkeypatch, tmp_path):
    monkeypatch.setattr(loop_check, "RUNS", 2)
    monkeypatch.setattr(loop_report, "POINTS", 3)
    about = {"load.lag": "5 ms", "network.meas.vibrometer.delay": "6 ms", "network.meas.vibrometer.jitter": "2 ms"}
    scene = rig.load("belt_poor_network", about)
    found = report(scene, "nf", bus=0.4e-3)
    items = {one.part: one for one in found.items}
    assert items["link meas/vibrometer"].seconds == pytest.approx(mean_age(scene.network.meas["vibrometer"], MS) * 1e-3)
    omega = abs(found.loop.spectrum.rates[0].imag)
    assert items["lag of load.force"].seconds == pytest.approx(math.atan(omega * 5e-3) / omega)
    assert items["lag of load.force"].origin == "load.lag (user)"
    assert items["bus of a paced run"].origin == "0.4 ms, measured: 1 frame"
    assert [curve.key for curve in found.curves] == ["delay", "jitter", "loss"]
    assert found.computed == found.growth  # the scene's own links are the point that is simulated
    assert found.error < 0.1
    assert f"relative error {found.error:.2g}" in found.text()
    put(found.plot(), tmp_path / "loop.png")
    assert (tmp_path / "loop.png").stat().st_size > 20_000


def test_a_loop_of_a_longer_period_has_the_longest_delay(monkeypatch):
    monkeypatch.setattr(loop_report, "POINTS", 3)
    monkeypatch.setattr(loop_check, "RUNS", 1)
    found = report(rig.load("belt_normal_force", {"controllers.nf.period": "5 ms"}), "nf")
    assert [curve.key for curve in found.curves] == ["delay", "jitter"]
    assert "longest constant delay" in found.notes[-1]
    assert found.checked is not None
    assert found.error < 0.01


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["belt"], "name the controller of the loop with --controller; there are: none"),
        (["belt_dither_sampled"], "is not a linear feedback"),
        (["belt_normal_force", "--net", "act/nf: loss 100 %"], "loses every message"),
        (
            ["belt_normal_force", "--net", "act/nf: los 1 %"],
            "network.act.nf.los: unknown key; did you mean network.act.nf.loss? (given with --net)",
        ),
    ],
)
def test_what_has_no_loop_is_refused(arguments, told):
    with pytest.raises((SceneError, rig.errors.UsageError)) as caught:
        program(["loop", *arguments], standalone_mode=False)
    assert told in str(caught.value)


def test_the_linear_controller_of_the_page_on_own_parts_has_a_report(rig):
    example = Path(__file__).parents[2] / "docs" / "example_linear.py"
    code, out, err = rig("loop", "belt", "--controller", example, "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["loop"]["through"] == "vibrometer to load.force"
    assert found["check"]["relative_error"] < 0.05

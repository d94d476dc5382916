"""The whole box of a design examined: closed loops, delays in whole frames, progress, and an interruption."""

import itertools
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import rig as lab
from rig.analysis.linear.all_loops import closed_rates
from rig.analysis.robust import certificate, design
from rig.analysis.robust.certificate import Examination, Polynomial, products
from rig.analysis.robust.growth import LOOP, MODES
from rig.analysis.robust.result import RobustResult
from rig.analysis.robust.search import PROVED, REFUTED, UNDECIDED, find, proved
from rig.analysis.robust.stated import prepared
from rig.errors import UsageError

BELT = {"friction.mu_static": "+-10 %", "drive.speed": "+-10 %"}
GAIN = {"controllers.nf.gain": 613.456}


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(design, "AUDIT", 50)


def loop_of(values):
    """The growth of the closed loop, whose controller is that of the scene."""
    return max(rate.real for rate in closed_rates(lab.load("belt_normal_force", GAIN | values)))


@pytest.mark.parametrize(("stated", "verdict"), [("0 ms:2 ms", PROVED), ("43 ms:45 ms", REFUTED)])
def test_closed_loops_are_proved_for_every_delay_in_whole_frames(tmp_path, small, stated, verdict):
    against = {"friction.mu_static": "+-10 %", "controllers.nf.delay": stated}
    job = prepared(lab.load("belt_normal_force", GAIN), {}, against, LOOP)
    search, folder = find(job, tmp_path, 1)
    known = proved(job, search, tmp_path, 1)
    found = RobustResult(job, search, {}, folder, known)
    assert known.verdict == verdict
    if verdict == PROVED:
        assert known.boxes >= 3  # 0, 1 and 2 ms
        assert "every delay of whole frames among them" in found.text()
        corners = itertools.product((0.45, 0.55), (0.0, 0.001, 0.002))
        each = [loop_of({"friction.mu_static": mu, "controllers.nf.delay": delay}) for mu, delay in corners]
        assert max(each) < 0.0
        assert found.worst >= max(each) - 1e-9
    else:
        rig = job.box.rig({}, known.rig)
        assert loop_of(rig) > 0.0
        assert "refuted by the rig" in found.text()


def test_a_proof_over_delays_only_has_a_box_for_each(tmp_path, small):
    job = prepared(lab.load("belt_normal_force", GAIN), {}, {"controllers.nf.delay": "0 ms:4 ms"}, LOOP)
    found = find(job, tmp_path, 1)[0]
    known = proved(job, found, tmp_path, 1)
    assert (known.verdict, known.boxes, known.share) == (PROVED, 5, 1.0)


def near_the_limit(folder):
    """A rig whose worst values just decay, so that its box has many parts, and what the search has found of it."""
    scene = lab.load("two_dof", {"spring_1.damping": 0.16, "spring_2.damping": 0.16, "spring_1.stiffness": 130.0})
    job = prepared(scene, {}, {"friction.mu": "+-20 %", "contact.stiffness": "+-20 %"}, MODES)
    return job, find(job, folder, 1)[0]


def test_a_proof_that_was_interrupted_goes_on_from_its_folder(tmp_path, small, monkeypatch):
    units = []
    examine = Examination.examined
    stops = [3]

    def counted(examination, low, high):
        units.append((*low, *high))
        if len(units) in stops:
            raise KeyboardInterrupt
        return examine(examination, low, high)

    monkeypatch.setattr(Examination, "examined", counted)
    job, found = near_the_limit(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        proved(job, found, tmp_path, 1)
    told = []
    resumed = proved(job, found, tmp_path, 1, lambda done, total: told.append((done, total)))
    count = len(units)
    assert len(set(units)) == count - 1  # the one that was interrupted again, and no other
    assert told == sorted(told)
    assert told[-1] == (1000, 1000)
    assert resumed.verdict == PROVED
    stops.clear()
    assert asdict(proved(job, found, tmp_path, 1)) == asdict(resumed)
    assert len(units) == count
    whole = proved(job, near_the_limit(tmp_path / "whole")[1], tmp_path / "whole", 1)
    assert asdict(whole) == asdict(resumed)


def test_two_workers_prove_the_same(tmp_path, small):
    job, found = near_the_limit(tmp_path)
    assert asdict(proved(job, found, tmp_path, 2)) == asdict(proved(*near_the_limit(tmp_path / "1"), tmp_path / "1", 1))


def test_what_cannot_be_proved_is_said(tmp_path, small, monkeypatch):
    job, found = near_the_limit(tmp_path)
    assert proved(job, found, tmp_path, 1, most=1).verdict == UNDECIDED
    monkeypatch.setattr(certificate, "_MOST", 10.0)
    job, found = near_the_limit(tmp_path / "large")
    known = proved(job, found, tmp_path / "large", 1)
    assert known.verdict == UNDECIDED
    assert "state a shorter delay or fewer uncertain values" in known.why


def test_a_part_is_expanded_anew():
    """The polynomial over a part of the box is that over the whole of it."""
    chance = np.random.default_rng(3)
    powers = chance.normal(size=(4, 3, 3))

    def matrix(u):
        return powers[0] + u[0] * powers[1] + u[1] ** 3 * powers[2] + u[0] ** 2 * u[1] * powers[3]

    polynomial = Polynomial(matrix, 2)
    low, high = np.array([0.2, 0.5]), np.array([0.3, 0.9])
    own = polynomial.within(low, high)
    for d in chance.uniform(-1.0, 1.0, (5, 2)):
        terms = products(d[None], polynomial.powers)[0]
        there = np.tensordot(terms, own, 1)
        assert there == pytest.approx(polynomial(0.5 * (low + high) + 0.5 * (high - low) * d), abs=1e-12)


@pytest.mark.parametrize("option", ["overrides", "untold"])
def test_a_key_that_is_free_and_fixed_is_refused_in_python_as_by_the_command(tmp_path, rig, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    key = "body.stiffness"
    words = {"overrides": ("-p, overrides", "-p"), "untold": ("--untold, untold", "--untold")}[option]
    told = rf"over {key}: is stated as one value as well ({words[0]}); leave one of the two out"
    over = {key: "2000 N/m:3000 N/m"}
    scene = "belt_normal_force"
    with pytest.raises(UsageError) as fault:
        lab.optimise(scene, over, MODES, against=BELT, **{option: {key: 2600.0}})
    assert str(fault.value) == told
    with pytest.raises(UsageError) as fault:
        lab.study(scene, {key: [2000.0, 3000.0]}, [MODES], **{option: {key: 2600.0}})
    assert str(fault.value) == told
    given = ["--over", f"{key}={over[key]}", words[1], f"{key}=2600 N/m"]
    for command in (["optimise", scene, "--minimise", MODES], ["study", scene, "--measure", MODES]):
        code, _, printed = rig(*command, *given)
        assert code == 2
        assert told in " ".join(printed.split())
    assert list(Path(tmp_path).iterdir()) == []

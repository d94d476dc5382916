"""What `rig explain --measure` tells: effects measured with and without, and methods."""

import rig
from rig.qualify import effects_measured
from rig.qualify.effects_measured import draw
from rig.record.provenance import provenance


def test_methods_say_why_they_do_not_serve():
    found = effects_measured.methods(rig.load("belt"))
    assert found["dopri5"] == "selected"
    assert "linear equations in every mode set; not linear: contact" in found["exact"]
    assert effects_measured.methods(rig.load("belt_c"))["exact"] == "selected"
    assert "film of contact points only" in found["kick"]
    told = effects_measured.methods(rig.load("plate"))
    assert told["kick"] == "selected"
    assert all("does not support a film" in told[method] for method in ("exact", "dopri5", "rk4"))


def test_an_absent_effect_is_measured_with_the_values_of_another_scene(monkeypatch, tmp_path):
    monkeypatch.setattr(effects_measured, "absent", lambda scene: {"tuned_mass": ["tuned_mass"]})
    monkeypatch.setattr(effects_measured, "effects", lambda scene, rounds: [])
    scene = rig.load("belt")
    [part] = effects_measured.parts(scene, rounds=3)
    assert not part.on
    assert "measured as in belt_tuned_mass" in part.why
    assert part.states == 2
    assert part.worst.size > 0.0
    draw([part], "its effects", provenance(1), tmp_path / "effects.png")
    assert (tmp_path / "effects.png").stat().st_size > 10_000

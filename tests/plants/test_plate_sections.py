"""Values of a plate scene that cannot go together: each is told, in words, before anything is computed."""

import pytest

import rig
from rig.errors import SceneError
from rig.scenes.explain import explain


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"plate.length": 100.0}, "the slider's way of 99.957 m is too long for points so close: at most 0.478 m"),
        ({"slider.position": 0.05}, "slider.position 0.05 m is beyond 0.0437 m"),
        ({"film.opens": False}, "only points that open can travel"),
        ({"film.completed": True}, "film.completed needs plate.damping: its last frequency is the band limit"),
        ({"plate.damping_ratio": 0.0, "plate.damping": [[5e4, 0.1], [1e4, 0.1]]}, "with rising frequencies and ratios"),
        ({"foam": None}, "[slider] needs [foam], which carries the load of the slider"),
        ({"clock.rk4_step": "4e-6 s"}, "kick is unstable"),
    ],
)
def test_what_does_not_go_together(values, said):
    with pytest.raises(SceneError) as error:
        rig.simulate(rig.load("plate", values), 0.001)
    assert said in str(error.value)


def test_explain_tells_how_a_point_sticks_and_how_far_it_gives_way():
    told = next(effect.about for effect in explain(rig.load("plate")).effects if effect.name == "friction at film")
    creep = 0.3 * (108.79 / 1087.9e-6) / (4e9 / 1e-3)  # mu p / (G / thickness)
    assert f"{creep * 1e9:.2g} nm at the most before it slips" in told

"""The scene file that `rig new` writes: the same scene as its base, until its comments are removed."""

import re

from rig import scenes
from rig.scenes.draft import draft


def test_a_draft_is_its_base(tmp_path, shipped):
    path = tmp_path / "mine.toml"
    for base in shipped:
        text = draft(base, base.name, "mine.toml")
        path.write_text(re.sub(r"^# (?=\w+ = [^#]* # .*; )", "", text, flags=re.MULTILINE))
        changed = scenes.load(path)
        assert changed.digest == base.digest, base.name
        assert len([key for key in base.origins if key not in changed.origins]) >= 3, base.name


def test_a_value_stands_with_its_unit_range_and_origin():
    text = draft(scenes.load("belt"), "belt", "mine.toml")
    assert '# speed = "0.06 m/s" # -100 to 100 m/s; calibrated: stick-slip of the pendulum rig\n' in text
    assert text.index("[drive]") < text.index("[load]") < text.index("[friction]") < text.index("[body]")
    assert "#   rig simulate mine.toml" in text

"""The catalogue of the page, as far as no browser and no rig is needed.

tests/web/browser/test_states.py compares it with the words of every plant and scene.
"""

import json
import re

from rig import scenes
from rig.plants import PLANTS
from rig.scenes.shipped import card, groups
from rig.web.app import PAGE

SECTIONS = json.loads((PAGE / "german.json").read_text(encoding="utf-8"))
MODULES = {path: path.read_text(encoding="utf-8") for path in PAGE.rglob("*.js")}


def test_texts_of_modules_titles_and_descriptions_of_scenes_and_words_of_plants_are_there():
    wanted = {text for module in MODULES.values() for text in re.findall(r'\bt\(\s*"((?:[^"\\]|\\.)*)"', module)}
    for name in scenes.names():
        shown = card(name)
        wanted |= {shown["title"], re.sub(r"([^\n])\n(?=\S)", r"\1 ", shown["about"])}
    wanted |= set(groups().values())
    wanted |= {hand.words for plant in PLANTS.shipped for hand in getattr(PLANTS[plant], "HANDS", {}).values()}
    assert len(wanted) > 400
    assert wanted - {text for entries in SECTIONS.values() for text in entries} == set()


def test_one_text_has_one_translation():
    told = [entry for entries in SECTIONS.values() for entry in entries.items()]
    assert {text for text, other in told if dict(told)[text] != other} == set()

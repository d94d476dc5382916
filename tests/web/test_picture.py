"""The moving picture and the contacts of the page: for every rig, before a run and frame by frame."""

import json
from types import SimpleNamespace

import pytest

import rig
from rig.bus import messages
from rig.plants import PLANTS
from rig.view import contact
from rig.view.channels import Channels
from rig.web.form import picture
from rig.web.frames import Frames
from rig.web.picture import MovingPicture


def frames_of(scene):
    """Frames of a rig, and a function that tells them a state (outputs that are not named are 0)."""
    assembly = scene.assemble()
    system, outputs = assembly.system(), {name: output.unit for name, output in assembly.outputs.items()}
    channels = Channels((scene, assembly), outputs, {})
    setup = SimpleNamespace(outputs=outputs, sensors={}, paced=True, run=scene.name)
    frames = Frames(setup, system, MovingPicture.of(scene, assembly, system, channels.colours))

    def tell(t_ns, key=0, **values):
        fields = {messages.field_name(name): values.get(name, 0.0) for name in outputs}
        said = SimpleNamespace(t_ns=t_ns, mode=key, **fields)
        frames.add([SimpleNamespace(topic="state", said=said, t_ns=t_ns)])
        return json.loads(frames.take().text)

    return frames, system, tell


@pytest.mark.parametrize("plant", PLANTS.shipped)
def test_every_rig_is_shown_before_a_run_and_moves_in_it(shipped, plant):
    scene = next(scene for scene in shipped if scene.plant == plant)
    still = picture(scene, scene.assemble())
    if not PLANTS[plant].__dict__.get("PICTURES") or plant == "structure":  # its three masses have no places
        assert still is None
        return
    json.dumps(still, allow_nan=False)
    paths = [path for path, _, _ in still["shapes"]]
    assert all(path.startswith("rig/") for path in paths)
    assert still["at"].keys() - {"rig/word"}
    _, _, tell = frames_of(scene)
    first = tell(0)["picture"]
    assert first.keys() == still["at"].keys()
    moved = tell(20_000_000, **dict.fromkeys(scene.assemble().outputs, 1e-2))["picture"]
    assert moved != first


def test_every_contact_has_its_own_mode():
    _, system, tell = frames_of(rig.load("brake_3400"))
    limits = [0] * len(system.limiters)
    assert contact.Contacts(system).names == ["inner_left", "inner_right", "outer_left", "outer_right"]
    key = system.key([0, 2], [0, 1, 0, 0], limits)
    words = [contact.NAMES[one] for one in tell(0, key)["now"]["contacts"]]
    assert words == ["slip+", "open", "stick", "stick"]

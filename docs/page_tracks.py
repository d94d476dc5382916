"""Make rig/web/page/tracks.json: short recordings of scenes, which the opening of the page shows as moving pictures.

python docs/page_tracks.py
"""

import json
from pathlib import Path

import numpy as np

import rig
from rig.view.channels import Channels
from rig.view.contact import Modes
from rig.web.picture import MovingPicture

FILE = Path(__file__).parents[1] / "rig" / "web" / "page" / "tracks.json"
FRAMES = 24
"""Pictures of one track, which lasts for about one period of the vibration and is shown again and again."""
SCENES = {  # scene -> time at which its track begins [s]
    "pendulum": 5.0,
    "belt": 3.0,
    "lever": 4.0,
    "tip": 0.05,
    "tread": 1.0,
    "seal_p": 3.0,
    "two_dof": 20.0,
    "four_dof": 14.0,
    "disc_slider": 4.0,
    "pin": 1.0,
    "plate": 0.2,
    "north": 0.5,
    "brake": 0.5,
    "belt_shunt": 3.0,
    "belt_tuned_mass": 0.2,
}
FEWER = {"brake": 12}
SHORTEST = 5
"""Fewest samples of a period."""


def track(name):
    """The picture of a scene at rest, and what moves in each of its frames."""
    begin, count = SCENES[name], FEWER.get(name, FRAMES)
    scene = rig.load(name)
    run = rig.simulate(scene, duration=begin + (0.05 if name in FEWER else 2.0))
    assembly = scene.assemble()
    system = assembly.system()
    outputs = {output: run.units[output] for output in run.signals}
    channels = Channels((scene, assembly), outputs, {})
    picture = MovingPicture.of(scene, assembly, system, channels.colours)
    t_ns, modes = np.rint(run.time * 1e9).astype(np.int64), Modes(system).indices(run.mode)
    first = int(np.searchsorted(run.time, begin))
    ends = first + np.rint(np.linspace(0, period(run, first, channels), count, endpoint=False)).astype(int)
    frames, before = [], first - 1
    for end in ends:
        rows = slice(before + 1, end + 1) if end > before else slice(end, end + 1)
        fields = picture.frame(t_ns[rows], {key: v[rows] for key, v in run.signals.items()}, modes[rows])
        frames.append({path: value for path, value in fields.items() if "labels" not in value})
        before = end
    return {"still": rounded(picture.still), **packed(frames)}


def period(run, first, channels):
    """Samples from `first` on after which the rig comes back nearest to where it was."""
    name = channels.portrait[0] if channels.portrait else next(iter(run.signals))
    pair = channels.portrait or (name,)
    x = np.array([run.signals[one][first:] for one in pair])
    x = (x - x.mean(axis=1, keepdims=True)) / (x.std(axis=1, keepdims=True) + 1e-30)
    away = np.linalg.norm(x - x[:, :1], axis=0)
    left = int(np.argmax(away > 1.0))
    later = np.flatnonzero(away[left:] < 0.25)
    if not later.size:
        return min(x.shape[1] - 1, 1000)
    start = left + later[0]
    return max(start + int(np.argmin(away[start : start + max(start // 4, 2)])), SHORTEST)


def packed(frames):
    """`first`, the fields of the first frame, and what `moves`: lists of path, field, its moving numbers, their steps.

    The numbers of a field are counted through its lists. Of each frame but the first there is the difference to the
    frame before of every number that moves, in thousandths. A field that changes its shape is given whole: its numbers
    are null.
    """
    first, moves = rounded({path: dict(fields) for path, fields in frames[0].items()}), []
    for path, name in dict.fromkeys(
        (path, name) for frame in frames for path, fields in frame.items() for name in fields
    ):
        values = [frame.get(path, {}).get(name) for frame in frames]
        for i in range(1, len(values)):
            values[i] = values[i - 1] if values[i] is None else values[i]
        if any(shape(value) != shape(values[0]) for value in values):
            moves.append([path, name, None, rounded(values[1:])])
            continue
        whole = np.rint(1000 * np.array([leaves(value) for value in values])).astype(int)
        moving = np.flatnonzero((whole != whole[0]).any(axis=0))
        if moving.size:
            moves.append([path, name, moving.tolist(), np.diff(whole[:, moving], axis=0).ravel().tolist()])
    return {"count": len(frames), "first": first, "moves": moves}


def shape(value):
    """The lengths of nested lists."""
    return [shape(one) for one in value] if isinstance(value, list) else value is None


def leaves(value):
    """The numbers of nested lists."""
    return [number for one in value for number in leaves(one)] if isinstance(value, list) else [value]


def rounded(value):
    """The same with three decimals."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [rounded(one) for one in value]
    return round(value, 3) if isinstance(value, float) else value


if __name__ == "__main__":
    made = {scene: track(scene) for scene in SCENES}
    FILE.write_text(json.dumps(made, separators=(",", ":")), encoding="utf-8")

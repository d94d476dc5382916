from pathlib import Path

import pytest

from rig.controllers.blocks.base import Controller, retune
from rig.controllers.runtime.file import load_file
from rig.controllers.runtime.loop import Loop
from rig.errors import UsageError

GOOD = """
class Controller:
    reads, drives, period_ns = ("v",), ("load.force",), 1_000_000
    def start(self):
        return 0.0
    def update(self, state, t_ns, values):
        return state, (20.0 - 100.0 * values[0],)
"""


def written(tmp_path, text, name="mine.py"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_a_file_with_a_class_is_a_controller(tmp_path):
    controller = load_file(written(tmp_path, GOOD))
    assert isinstance(controller, Controller)
    assert Loop(controller).answer(0, (0.1,)) == (10.0,)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("class Controller:\n    def f(:\n", r"SyntaxError.*\(line 2\)"),
        ("import rig.study.modes\n", r"\(line 1\); it is now rig\.analysis, rig\.qualify or rig\.papers"),
        (GOOD.replace('("v",)', '"v"'), "Controller.reads is 'v'; expected a tuple"),
        (GOOD.replace("return state, (", "return ("), "expected .state, commands."),
        (GOOD.replace("values[0]", "values[1]"), r"IndexError.*\(line 7\)"),
    ],
)
def test_what_is_wrong_with_a_file_is_told_with_its_line(tmp_path, text, fault):
    with pytest.raises(UsageError, match=fault):
        load_file(written(tmp_path, text))


def test_the_example_of_the_documentation_works_and_can_be_tuned():
    path = Path(__file__).parents[2] / "docs" / "example_controller.py"
    assert len(path.read_text().splitlines()) <= 45
    controller = load_file(path)
    state, (low,) = controller.update(controller.start(), 0, (0.05,))
    _, (high,) = controller.update(state, controller.period_ns, (-0.05,))
    assert low < high
    stronger = retune(controller, {"swing": "15 N"})
    assert stronger.update(state, 0, (0.05,))[1][0] < low
    with pytest.raises(UsageError, match="swing"):
        retune(controller, {"swing": "8 kg"})


def test_a_file_of_another_tool_is_a_controller_with_the_keys_of_its_table(tmp_path):
    (tmp_path / "k.json").write_text('{"num": [-200.0], "den": [0.002, 1.0], "dt": 0, "inputs": ["vibrometer"]}')
    keys = {"drives": "load.force", "method": "tustin", "nominal": "20", "highest": 100.0}
    made = load_file(tmp_path / "k.json", keys)
    assert (made.reads, made.drives, made.period_ns) == (("vibrometer",), ("load.force",), 1_000_000)
    assert made.update(made.start(), 0, (0.0,))[1] == (20.0,)
    for wrong, told in (
        ({**keys, "method": "zoe"}, "method: Input should be 'zoh'"),
        ({"method": "zoh"}, "drives: is missing"),
        ({**keys, "highest": "9 N"}, "the unit of load.force is not known here"),
    ):
        with pytest.raises(UsageError, match=told) as refused:
            load_file(tmp_path / "k.json", wrong)
        assert "k.json: " in str(refused.value)
    with pytest.raises(UsageError, match=r"k\.txt: no kind of controller reads such a file"):
        load_file(tmp_path / "k.txt")

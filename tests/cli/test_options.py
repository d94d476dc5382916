"""An option is stated once: on a function of `rig`, or on that of its command; those of all commands in one place."""

from inspect import signature
from typing import Annotated

import pytest

import rig as package
from rig.cli import build
from rig.cli.app import COMMANDS, every
from rig.cli.stated import stated
from rig.errors import ExitCode
from rig.parameters import Option

SAID_OTHERWISE = {"simulate": {"scene"}, "diff": {"first", "second"}, "import": {"files", "out"}}
"""Arguments that a command may do without, or that are files where the function takes what has been read."""


def test_a_command_states_no_option_of_its_function_of_rig_again():
    twice = {
        name: {*stated(made.work)} & {*signature(made.of).parameters} for name, made in COMMANDS.items() if made.of
    }
    assert {name: names for name, names in twice.items() if names} == SAID_OTHERWISE


def test_what_a_function_of_rig_states_is_an_option_of_its_command():
    for name, command in every().items():
        made = COMMANDS[name.rpartition(" ")[2]]
        helps = {one.name: one.help for one in command.params}
        left = stated(made.of).keys() - helps.keys() if made.of else set()
        assert not left, name
        for one, option in (stated(made.of) if made.of else {}).items():
            assert option.option.help in (helps[one], "Name of a shipped scene (see rig list), or a TOML file."), name


def test_no_word_of_a_help_in_brackets_is_taken_for_a_style():
    from rich.text import Text

    for name, command in every().items():
        for words in filter(None, (command.help, command.epilog, *(option.help for option in command.params))):
            assert Text.from_markup(words).plain == words, name


def twice(
    length: Annotated[float | None, Option("TIME", "A length of time.")] = 2.0,
    names: Annotated[list[str] | None, Option("NAMES", "Names, separated by commas.")] = None,
    most: Annotated[int, Option("N", "Largest number.", low=1, high=9)] = 3,
) -> None:
    """A function of `rig`."""


def _called(work, **typed):
    command = build.build(build.Made(work, "", twice))
    given = {name: one.default for name, one in signature(command).parameters.items()}
    command(**given | typed)


def test_texts_become_the_values_of_the_parameters():
    got = {}

    def work(**given) -> None:
        got.update(given)

    _called(work)
    assert got == {"length": 2.0, "names": None, "most": 3}
    _called(work, length="500 ms", names="a, b", most=4)
    assert got == {"length": 0.5, "names": ["a", "b"], "most": 4}
    with pytest.raises(package.errors.UsageError, match="--length is '3 kg'; expected a unit that converts to s"):
        _called(work, length="3 kg")


def test_an_argument_may_have_the_name_of_a_file_that_others_write(rig):
    code, out, _ = rig("tool", "reproduce", "--json")
    assert code == 0
    assert '"name": "kroeger-3"' in out


def test_every_fault_of_the_options_is_told_at_once(rig):
    code, _, err = rig("live", "plant", "belt", "--wait", "3 kg", "--duration", "2 kg")
    assert code == ExitCode.MISTAKE
    assert [line.partition(" ")[0] for line in err.splitlines()] == ["--duration", "--wait"]

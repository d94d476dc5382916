"""Command lines that make no sense: each ends at once, in words, with the exit code of a mistake."""

import random
import signal

import pytest

from rig.cli import app

SECONDS = 30
"""In which every one of them must have ended."""
NOTHING = ("", " ", "x", "nan", "-nan", "1e", "1..2", "٣٣x", "1;2", "[]", "5 kg", "1 " + "(" * 300, "9" * 5000 + "x")
LARGE = ("inf", "-inf", "1e300", "-1e300", "1e999", "9" * 5000, "-1", "-1 s", "1e300 s")
SMALL = ("0", "1e-300", "5e-324", "-0.0")
COUNTS = ("", "x", "0", "-1", "1", "1.5", "nan", "1e9", "1" * 5000, "²", "٣", "99999999999", "0x10")
NAMES = (
    "",
    ".",
    "..",
    "/",
    "/dev/null",
    "/dev/zero",
    "a\nb",
    "x" * 5000,
    "../../etc/passwd",
    "no such thing",
    "-",
    "~",
)
SECONDS_OF = {
    "--duration": (("run", "belt"), ("simulate", "belt"), ("plant", "belt")),
    "--pace": (("run", "belt"), ("plant", "belt")),
    "--longest": (("map", "belt", "--x", "drive.speed=0.05:0.8:4"),),
}
WAITS = {
    "--wait": (("plant", "belt"), ("control", "nf"), ("record",), ("view",)),
    "--for": (("topic", "ls"), ("topic", "hz")),
}
SHARES = {
    "--budget": (("run", "belt"), ("cost", "belt")),
    "--accuracy": (("run", "belt"),),
    "--target": (("cost", "belt"),),
}
WHOLE = {"--workers": (("map", "belt", "--x", "drive.speed=0.05:0.8:4"),), "--count": (("topic", "echo", "*"),)}
OF_SCENES = ("explain", "modes", "cycle", "identify", "run", "simulate", "plant", "cost")
OF_LOGS = ("verify", "replay", "amplitude", "sound", "recover")


def lines():
    """Command lines that must be refused."""
    for options, odd in (
        (SECONDS_OF, (*NOTHING, *LARGE, *SMALL)),
        (WAITS, (*NOTHING, *LARGE)),
        (SHARES, (*NOTHING, *LARGE, *SMALL)),
        (WHOLE, ("", "x", "-1", "1.5", "nan", "1e9", "9" * 5000)),
    ):
        for option, commands in options.items():
            for command in commands:
                yield from ((*command, f"{option}={value}") for value in odd)
    for command in OF_SCENES:
        yield from ((command, name) for name in NAMES)
        for value in ("1e300", "1e-300", "nan", "inf", "9" * 5000, "", "x", "[]", "{}", "-5"):
            yield command, "belt", "-p", f"body.mass={value}"
            yield command, "belt", "-p", f"load.force={value}" if value != "1e-300" else "clock.frame=1 ns"
        yield from ((command, "belt", "-p", text) for text in ("", "=", "x", "=1", ".=1", "a..b=1", "x" * 5000))
    for ends in ("0:1:" + count for count in COUNTS):
        yield "modes", "belt", f"--sweep=drive.speed={ends}"
        yield "map", "belt", f"--x=drive.speed={ends}"
    for ends in (
        "",
        ":",
        "::",
        ":::",
        "nan:1:5",
        "0:inf:5",
        "1e300:2e300:5",
        "-1e300:1e300:5",
        "1:1:5",
        "0:1 kg:5",
        "a:b:c",
    ):
        yield "modes", "belt", f"--sweep=drive.speed={ends}"
        yield "map", "belt", f"--x=drive.speed={ends}"
        yield "modes", "belt", f"--sweep={ends}=0:1:5"
    for command in OF_LOGS:
        yield from ((command, name) for name in NAMES)
    yield from (("export", name, "--to=csv") for name in NAMES)
    yield from (("export", "/dev/null", f"--to={name}") for name in NAMES)
    for name in NAMES:
        yield "diff", name, name
        yield "torture", f"--case={name}"
        yield "reproduce", name or "x"
        yield "warmup", name
        yield "modes", "belt", f"--controller={name or 'x'}"
        yield "simulate", "belt", f"--method={name}"
        yield "tune", name, "1"
        yield "control", name, "--wait=0"
    yield from ((*command, "--run=" + name, "--wait=0") for name in NAMES for command in (("record",), ("view",)))


@pytest.fixture
def end(capsys, monkeypatch, tmp_path):
    """Exit code and what was said of a command line, run in this process in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "200")

    def late(*_):
        raise AssertionError(f"not ended within {SECONDS} s")

    def call(arguments):
        before = signal.signal(signal.SIGALRM, late)
        signal.alarm(SECONDS)
        try:
            with pytest.raises(SystemExit) as left:
                app.run(list(arguments))
        finally:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)
        said = capsys.readouterr()
        return left.value.code or 0, said.out + said.err

    return call


ALL = sorted(set(lines()), key=str)
random.Random(1).shuffle(ALL)


def judge(end, chosen):
    """The command lines among `chosen` that were not refused in words."""
    wrong = []
    for arguments in chosen:
        short = [one[:40] for one in arguments]
        try:
            code, said = end(arguments)
        except BaseException as error:  # what ends the program in any other way is what is looked for
            if isinstance(error, KeyboardInterrupt):
                raise
            wrong.append(f"{short}: {type(error).__name__}: {str(error)[:200]}")
            continue
        if code != 2 or not said.strip() or "Traceback" in said or len(said) > 20_000:
            wrong.append(f"{short}: exit code {code}, {len(said)} letters: {said[:200]}")
    return wrong


def test_a_senseless_command_line_is_refused_in_words(end):
    assert judge(end, ALL[:250]) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(4))
def test_every_senseless_command_line_is_refused_in_words(end, part):
    assert judge(end, ALL[250 + part :: 4]) == []


@pytest.mark.parametrize(
    "twice",
    [
        ("run", "belt", "--trigger", "laser > 1 mm", "--trigger", "vibrometer > 0.1 m/s"),
        ("export", "/dev/null", "--to", "csv", "--only=a", "--only", "b"),
        ("simulate", "belt", "--duration", "1", "--duration=2"),
        ("topic", "echo", "--run", "a", "--run", "b"),
    ],
)
def test_an_option_with_one_value_is_not_given_twice(end, twice):
    code, said = end(twice)
    assert code == 2
    assert "is given twice, and takes one value" in said

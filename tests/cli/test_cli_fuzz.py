"""Command lines that make no sense: each ends at once, in words, with the exit code of a mistake."""

import signal

import pytest

from rig.cli import app

SECONDS = 30
"""In which every one of them must have ended."""
NUMBERS = ("", "x", "nan", "-inf", "1e300", "-1 s", "5 kg")
COUNTS = ("", "x", "-1", "1.5", "nan", "99999999999")
NAMES = ("", "/", "no such thing")
RANGES = ("", ":", "0:1:0", "0:1:1.5", "0:1:99999999999", "nan:1:5", "0:inf:5", "-1e300:1e300:5", "1:1:5", "a:b:c")
MAP = "map belt --x drive.speed=0.05:0.8:4"
SENSELESS = (
    (("run belt", "simulate belt", "live plant belt"), "--duration={}", (*NUMBERS, "0")),
    (("run belt", "live plant belt"), "--pace={}", (*NUMBERS, "0")),
    (("live plant belt", "live control nf", "live record", "view"), "--wait={}", NUMBERS),
    (("run belt", "cost belt"), "--budget={}", (*NUMBERS, "0")),
    (("run belt --accuracy={}", "cost belt --target={}"), "", ("", "x", "nan", "0", "-1", "1")),
    ((f"{MAP} --workers={{}}", "live topic echo * --count={}"), "", COUNTS),
    ((MAP,), "--longest={}", (*NUMBERS, "0")),
    (("explain belt", "modes belt"), "-p body.mass={}", ("1e300", "1e-300", "nan", "", "x", "[]", "-5")),
    (("explain belt",), "-p {}", ("", "x", "=1")),
    (("modes belt --sweep=drive.speed={}", "map belt --x=drive.speed={}"), "", RANGES),
    (("explain", "modes", "cycle", "identify", "run", "simulate", "live plant", "cost"), "{}", NAMES),
    (("verify", "recover", "export --to=csv", "live replay", "live tune", "tool warmup"), "{}", NAMES),
    (("analyse amplitude", "analyse sound"), "{}", NAMES),
    (("live record --wait=0", "view --wait=0"), "--run={}", NAMES),
)
"""Commands, what is added to them, and values of it."""


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


@pytest.mark.parametrize(("commands", "more", "values"), SENSELESS, ids=range(len(SENSELESS)))
def test_a_senseless_command_line_is_refused_in_words(end, commands, more, values):
    for command in commands:
        for value in values:
            arguments = [part.replace("{}", value) for part in f"{command} {more}".split()]
            code, said = end(arguments)
            short = [one[:40] for one in arguments]
            assert (code, "Traceback" in said) == (2, False), (short, said[:200])
            assert 0 < len(said.strip()) < 20_000, short

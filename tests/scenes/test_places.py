"""Lines of keys in TOML: those of everything that tomllib reads, in each way of writing it."""

import tomllib

from rig import scenes
from rig.scenes.places import lines, parts

TEXT = '''\
title = "a # b = [c]" # not = a key
about = """
x = 1
[no.table]
say \\""" and ""\\" and so on"""
raw = \'\'\'
[[no]] \'\'\'

"quoted key".'second' = 1979-05-27T07:32:00Z
a . b = { c = [1, [2, "]"], { d = 1e3 }], e.f = 'x,y' }
empty = []
list = [ # comment ]
  { x = 1 }, # {
  { y = [
    { z = 2 },
  ] },
]

[ table . sub ] # [x]
key = -0.5
  [table]
  other = true
[[rows]]
one = 1
[[rows]]
two = 2
[rows.inner]
three = 3
[[rows.deep]]
four = 4
[[rows.deep]]
five = 5
'''


def keys(raw, key=""):
    for name, value in raw.items():
        inside = f"{key}.{name}" if key else name
        yield inside
        yield from within(value, inside)


def within(value, key):
    if isinstance(value, dict):
        yield from keys(value, key)
    elif isinstance(value, list):
        for i, one in enumerate(value, 1):
            if isinstance(one, dict):
                yield f"{key}[{i}]"
            yield from within(one, f"{key}[{i}]")


def test_each_key_is_found_on_its_line():
    found = lines(TEXT)
    expected = {
        "title": 1, "about": 2, "raw": 6, "quoted key.second": 9, "a.b": 10, "a.b.c": 10, "a.b.c[3]": 10,
        "a.b.c[3].d": 10, "a.b.e.f": 10, "empty": 11, "list": 12, "list[1]": 13, "list[1].x": 13, "list[2]": 14,
        "list[2].y": 14, "list[2].y[1]": 15, "list[2].y[1].z": 15, "table.sub": 19, "table.sub.key": 20, "table": 21,
        "table.other": 22, "rows[1]": 23, "rows[1].one": 24, "rows[2]": 25, "rows[2].two": 26, "rows[2].inner": 27,
        "rows[2].inner.three": 28, "rows[2].deep[1]": 29, "rows[2].deep[1].four": 30, "rows[2].deep[2]": 31,
        "rows[2].deep[2].five": 32,
    }  # fmt: skip
    assert found == expected


def test_what_tomllib_reads_is_found():
    """Tables that no header names are found by their keys alone."""
    for text in (TEXT, TEXT.replace("\n", "\r\n"), *(scenes.path(name).read_text() for name in scenes.names())):
        found, read = set(lines(text)), set(keys(tomllib.loads(text)))
        assert found <= read
        assert all(any(other.startswith((f"{key}.", f"{key}[")) for other in found) for key in read - found)


def test_parts_are_the_letters_of_each_name():
    assert [(part.key, TEXT[part.begin : part.end]) for part in parts(TEXT)][3:8] == [
        ("quoted key", '"quoted key"'),
        ("quoted key.second", "'second'"),
        ("a", "a"),
        ("a.b", "b"),
        ("a.b.c", "c"),
    ]

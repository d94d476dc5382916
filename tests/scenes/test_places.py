"""Lines of keys in TOML, in each way of writing them."""

from rig.scenes.places import lines

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


def test_each_key_is_found_on_its_line():
    expected = {
        "title": 1, "about": 2, "raw": 6, "quoted key.second": 9, "a.b": 10, "a.b.c": 10, "a.b.c[2]": 10,
        "a.b.c[3]": 10, "a.b.c[3].d": 10, "a.b.e.f": 10, "empty": 11,
        "list": 12, "list[1]": 13, "list[1].x": 13, "list[2]": 14,
        "list[2].y": 14, "list[2].y[1]": 15, "list[2].y[1].z": 15, "table.sub": 19, "table.sub.key": 20, "table": 21,
        "table.other": 22, "rows[1]": 23, "rows[1].one": 24, "rows[2]": 25, "rows[2].two": 26, "rows[2].inner": 27,
        "rows[2].inner.three": 28, "rows[2].deep[1]": 29, "rows[2].deep[1].four": 30, "rows[2].deep[2]": 31,
        "rows[2].deep[2].five": 32,
    }  # fmt: skip
    assert lines(TEXT) == lines(TEXT.replace("\n", "\r\n")) == expected

"""Many messages decoded at once are, bit for bit, those that protobuf decodes one by one."""

from array import array

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rig.bus import columns, encode, messages

whole = st.integers(-(2**63), 2**63 - 1)
reals = st.floats(width=64)


def same_as_single(kind, payloads):
    """Whether the columns of `payloads` together are those of each decoded by protobuf."""
    found = columns.alike(kind, payloads)
    assert found is not None
    alone = [columns.single(kind.FromString(payload)) for payload in payloads]
    assert found.keys() == {field.name for field in kind.DESCRIPTOR.fields}
    for name, column in found.items():
        expected = np.concatenate([one[name] for one in alone])
        assert (column.dtype, column.shape) == (expected.dtype, expected.shape), name
        assert column.tobytes() == expected.tobytes(), name
    return True


@given(
    st.integers(0, 20).flatmap(
        lambda n: st.lists(st.tuples(whole, st.lists(reals, min_size=n, max_size=n)), min_size=1, max_size=4)
    )
)
def test_blocks(rows):
    assert same_as_single(messages.TYPES["Block"], [encode.block(t, t // 2, 7, np.array(v, float)) for t, v in rows])


def test_blocks_with_uneven_times_and_states_of_many_outputs():
    times = np.array([3, 5, 11])
    blocks = [encode.block(k, k, 0, np.array([1.0, np.nan, -0.0]) * k, times + k) for k in range(5)]
    assert same_as_single(messages.TYPES["Block"], blocks)
    state = encode.StateEncoder(30)  # fields beyond 15 have longer tags
    states = [state(k, -k, 2, np.arange(30.0) + k) for k in range(4)]
    assert same_as_single(messages.state_type([f"x{i}" for i in range(30)]), states)


def test_commands_alone_and_several_in_one_message():
    kind = messages.TYPES["Applied"]
    assert same_as_single(kind, [encode.applied(k, 1000 * k, k - 1, 0, [0.1 * k, 1.0]) for k in range(6)])
    three = [[array(code, (k + i for i in range(3))) for code in "qqqd"] for k in range(4)]
    assert same_as_single(kind, [encode.commands(1000, *one) for one in three])

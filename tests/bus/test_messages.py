"""The bytes on the wire: what is packed by hand is what the stock protobuf library reads and writes."""

from array import array

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.bus import encode, messages, topics
from rig.errors import BusError

whole = st.integers(-(2**63), 2**63 - 1)
reals = st.lists(st.floats(width=64), max_size=300)


def same(found, expected) -> bool:
    return np.array_equal(np.asarray(found).view("u8"), np.asarray(expected, dtype=float).view("u8"))


def test_block_has_these_bytes():
    golden = bytes.fromhex("0907000000000000001140420f000000000019a0860100000000002210000000000000f03f00000000000000c0")
    assert encode.block(7, 1_000_000, 100_000, np.array([1.0, -2.0])) == golden
    assert messages.TYPES["Block"](tick=7, t0_ns=1_000_000, dt_ns=100_000, v=[1.0, -2.0]).SerializeToString() == golden


def equal(packed: bytes, kind: str, **fields) -> bool:
    """Whether packed bytes are read as this message, to the bit of every number.

    What both write is compared: the packer also writes a field that is zero, the stock library leaves it out.
    """
    made = messages.TYPES[kind]
    return made.FromString(packed).SerializeToString() == made(**fields).SerializeToString()


@given(whole, whole, reals, st.dictionaries(st.integers(0, 9), reals, max_size=4))
def test_any_step_is_what_the_stock_library_writes(tick, t_ns, values, samples):
    heard = {place: np.array(new, dtype=float) for place, new in sorted(samples.items())}
    fresh = np.array([len(samples.get(place, ())) for place in range(10)])
    packed = encode.step(tick, t_ns, np.array(values, dtype=float), fresh, heard)
    new = [v for _, numbers in sorted(samples.items()) for v in numbers]
    assert equal(packed, "Step", tick=tick, t_ns=t_ns, values=values, fresh=fresh, heard=sorted(samples), samples=new)


@given(whole, whole, reals)
def test_any_act_is_what_the_stock_library_writes(tick, t_ns, values):
    assert equal(encode.act(tick, t_ns, values), "Act", tick=tick, t_ns=t_ns, values=values)


@given(whole, whole, whole, reals, st.none() | st.lists(whole, min_size=1, max_size=300))
def test_any_block_is_what_the_stock_library_writes(tick, t0_ns, dt_ns, v, times):
    packed = encode.block(tick, t0_ns, dt_ns, np.array(v, dtype=float), None if times is None else np.array(times))
    assert equal(packed, "Block", tick=tick, t0_ns=t0_ns, dt_ns=dt_ns, v=v, t_ns=times or ())


@given(whole, whole, whole, whole, reals)
def test_any_applied_is_what_the_stock_library_writes(tick, t_ns, answered, status, values):
    fields = {"tick": tick, "t_ns": t_ns, "answered": answered, "status": status, "values": values}
    assert equal(encode.applied(**fields), "Applied", **fields)


commands = st.lists(
    st.tuples(whole, whole, whole, st.tuples(st.floats(width=64), st.floats(width=64))), min_size=1, max_size=30
)


def columns_of(rows):
    columns = [array("q", column) for column in zip(*((t % 10**9, a, s) for t, a, s, _ in rows))]
    return columns, array("d", [one for *_, values in rows for one in values])


@given(commands)
def test_many_applied_are_encoded_like_each_of_them(rows):
    columns, values = columns_of(rows)
    each = [encode.applied(t % 10**9, t % 10**9 * 50, a, s, values) for t, a, s, values in rows]
    assert encode.each_applied(50, *columns, values) == each


@given(commands)
def test_any_commands_in_one_applied_come_back_bit_for_bit(rows):
    columns, values = columns_of(rows)
    read = messages.commands(messages.decode("applied/x", encode.commands(50, *columns, values)))
    assert list(read.tick) == [tick % 10**9 for tick, *_ in rows]
    assert list(read.answered) == [answered for _, answered, *_ in rows]
    assert list(read.status) == [status for _, _, status, _ in rows]
    assert same(read.values, [one for *_, values in rows for one in values])


@pytest.mark.parametrize("count", [1, 13])
def test_state_is_what_the_stock_library_writes(count):
    names = [f"output.{i}" for i in range(count)]
    kind, pack = messages.state_type(names), encode.StateEncoder(count)
    for shift in (1.0, 2.0):  # the buffer is used again
        values = np.arange(count) + shift
        stock = kind(t_ns=5, tick=6, mode=-1, **{messages.field_name(n): v for n, v in zip(names, values)})
        assert pack(5, 6, -1, values) == stock.SerializeToString()


def test_names_that_collide_in_a_message_are_refused():
    with pytest.raises(BusError, match="drive_speed"):
        messages.state_type(["drive.speed", "drive_speed"])
    with pytest.raises(BusError, match="tick"):
        messages.state_type(["tick"])


def test_a_wrong_topic_names_the_near_ones():
    with pytest.raises(BusError, match="near: health"):
        topics.of("helth")
    with pytest.raises(BusError, match="meas/<sensor>"):
        topics.of("meas")
    with pytest.raises(BusError, match="names are letters"):
        topics.of("meas/*")

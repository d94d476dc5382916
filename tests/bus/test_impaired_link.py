"""Impaired links: what becomes of a message depends on seed, name of the link and its number alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.bus.impaired_link import HeardSensor, ImpairedLink

MS = 1_000_000
MESSAGES = 300

links = st.builds(
    lambda seed, delay, share, loss, duplicate, reorder: ImpairedLink(
        "meas/v", seed, MS, delay, int(share * delay), loss, duplicate, reorder
    ),
    st.integers(0, 2**64),
    st.integers(0, 20 * MS),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.booleans(),
)


@given(links)
def test_copies_arrive_within_the_bounds_of_the_link_and_every_message_is_counted(link):
    arrived = [(tick, at) for tick in range(MESSAGES) for at in link.arrivals(tick, tick)]
    assert all(tick + link.least <= at <= tick + link.most for tick, at in arrived)
    counts = link.counts
    assert len(arrived) == counts.sent - counts.lost + counts.duplicated
    assert counts.delayed == sum(at > tick for tick, at in arrived)
    assert counts.lost == sum(link.loses(number) for number in range(MESSAGES))
    if not link.reorder:
        assert [at for _, at in arrived] == sorted(at for _, at in arrived)
        assert counts.reordered == 0


@given(st.integers(0, 2**40), st.integers(0, 1000), st.integers(0, 40))
def test_a_random_number_belongs_to_its_message(seed, first, ahead):
    link = ImpairedLink("act/nf", seed, MS)
    together = link.numbers(first, ahead + 1)
    assert together[ahead].tobytes() == link.numbers(first + ahead, 1)[0].tobytes()
    assert ((together >= 0.0) & (together < 1.0)).all()


def test_probabilities_and_latencies_are_those_that_are_stated():
    link, count = ImpairedLink("meas/v", 1, MS, 5 * MS, 3 * MS, 0.2, 0.1, reorder=True), 20_000
    found = [link.arrivals(tick, tick) for tick in range(count)]
    counts = link.counts
    assert counts.lost / count == pytest.approx(0.2, abs=5 * (0.2 * 0.8 / count) ** 0.5)
    left = count - counts.lost
    assert counts.duplicated / left == pytest.approx(0.1, abs=5 * (0.1 * 0.9 / left) ** 0.5)
    latencies = np.array([at - tick for tick, ticks in enumerate(found) for at in ticks])
    assert np.unique(latencies).tolist() == [3, 4, 5, 6, 7, 8][1 if 3 not in latencies else 0 :]
    # uniform within 2 .. 8 ms and rounded up to ticks: 3 .. 8, each with a sixth
    shares = np.bincount(latencies)[3:] / latencies.size
    assert shares == pytest.approx([1 / 6] * 6, abs=5 * (5 / 36 / latencies.size) ** 0.5)


def test_links_and_seeds_are_independent():
    def lost(name, seed):
        link = ImpairedLink(name, seed, MS, loss=0.5)
        return [link.loses(number) for number in range(400)]

    one = lost("meas/a", 1)
    for other in (lost("meas/b", 1), lost("meas/a", 2), lost("act/a", 1)):
        assert 120 < sum(a == b for a, b in zip(one, other)) < 280


def test_without_reordering_a_late_message_delays_those_behind_it():
    kept, overtaken = (
        HeardSensor(ImpairedLink("meas/v", 3, MS, 4 * MS, 4 * MS, reorder=reorder)) for reorder in (False, True)
    )
    heard = [[one.tick(tick, [float(tick)]) for tick in range(200)] for one in (kept, overtaken)]
    order = [[sample for samples in one for sample in samples] for one in heard]
    assert order[0] == sorted(order[0])
    assert order[1] != sorted(order[1])
    assert set(order[0]) | set(order[1]) <= set(map(float, range(200)))
    assert overtaken.link.counts.reordered > 0

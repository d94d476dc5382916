"""A recording again: continued, replayed, verified.

fork      continues a recording from one of its instants, with other values; history: what it takes from it
replay      plays a recording back on the bus, with controllers as processes that receive it
verify      simulates a recording again and compares: commands, events, samples
agreement   the comparison of samples, also between processors
"""

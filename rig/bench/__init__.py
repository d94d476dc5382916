"""The bench runs a rig, in one process or with other processes.

run     one run of a rig: what happens at a tick is the same in every mode
live    a live run: the plant process with its pace, its connection to the bus, its supervisor
again   a recording again: continued, replayed, verified
"""

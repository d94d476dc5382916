"""A rig in motion: its state, time and mode sets, advanced by compiled code.

motion            one rig in motion: write commands, advance, read outputs and energy
memory            the memory of a motion: state, log and segments, which compiled code reads and writes
plan              how it is advanced: method, options and the compiled parts that these need
compiled_parts    finds or compiles those parts
ready             a system made ready for a motion: mode sets, scratch memory, plan
balance           the energy balance and its residual, that of the contacts under the method kick too
stops             why a motion has to stop, in words
"""

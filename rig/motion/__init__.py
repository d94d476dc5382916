"""A rig in motion: its state, its time and its mode sets, carried forward by compiled code.

motion            one rig in motion: write commands, advance, read outputs and energy
plan              how it is carried: method, options and the compiled parts that this needs
compiled_parts    finds or compiles those parts
contact_springs   energy of the contacts under the method kick
"""

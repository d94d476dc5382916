"""A rig in motion: its state, time and mode sets, advanced by compiled code.

motion            one rig in motion: write commands, advance, read outputs and energy
stop              why it has to stop, and where, in words
ready             a system made ready for a motion: mode sets, scratch memory, plan of its kernels
compiled_parts    finds or compiles those parts
balance           the energy balance and its residual
"""

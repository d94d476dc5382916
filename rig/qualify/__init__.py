"""Qualification of the simulator: cost, hard cases, effects, this machine.

cost              error against compute time, per method and step
torture           hard cases by methods by steps, each with a test result
effects_measured  cost of each effect of a scene, and what changes without it; effects_figure draws it
frame_costs       compute time of the frames of a scene
doctor            the load that this machine can handle; round_trip: the latency of the bus here
warmup            compiles the kernels of the shipped scenes
benchmarks        the numbers of `make bench`
"""

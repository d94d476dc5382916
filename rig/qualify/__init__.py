"""Qualification of the simulator: cost, hard cases, effects, this machine.

cost              error against compute time, per method and step
torture           hard cases by methods by steps, each with a test result
effects_measured  cost of each effect of a scene, and what changes without it
doctor            the load that this machine can handle: compute time of frames, latency of the bus
"""

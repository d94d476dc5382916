"""What one learns from a rig.

design      plant matrices in, controller numbers out
modes       eigenvalues at the sliding equilibrium
averaged    friction under a fast vibration, averaged
cycle       the limit cycle
doctor      this machine: how well it keeps time, which scenes it carries
warmup      compiling every kernel shape of the shipped scenes
"""

"""What one learns from a rig.

design      plant matrices in, controller numbers out
modes       eigenvalues at the sliding equilibrium
axis        a parameter at evenly spaced values, as a user writes it
sweep       eigenvalues over a parameter, critical values; `spectrum` tells which is which, `locus` draws them
plant       the linearised rig as a state space from actuators to outputs
loop        closed-loop eigenvalues and margins of a controller; `sampled` is its exact discretisation
averaged    friction under a fast vibration, averaged
cycle       the limit cycle; `orbit` carries the plant, `turns` finds cycles without events
floquet     what a round of a cycle leaves of a small disturbance
amplitude   the amplitude index of a measured vibration
stages      speeds at which stick ends and begins, from a run that accelerates, holds and decelerates
identify    the experiments that tell a rig's parameters
repeat      one scene with many seeds: how its numbers spread
dense       quantities between samples
doctor      this machine: how well it keeps time, which scenes it carries
round_trip  what the bus costs here
warmup      compiling every kernel shape of the shipped scenes
"""

"""What this machine does: figures for docs/benchmarks.md, made by `make bench`. Nothing here is a test.

kernels  real-time factor of the pendulum over event-time error, per method; ratio to scipy
twins    kernels against their C twins: quiet tick, fixed step, the exact run of a stiff shunt, a film of points (film)
absent   what an effect costs that is not there
whole    the whole `rig simulate` of the pendulum and of a squealing brake, and the start of a new process
disc     the slider on a flexible disc with seven modes: real-time factor over the error of its growth rate
maps     a map of 100 x 100 points: its time, and what a second core brings
loop     the paced loop over the bus: round trip, ages, losses
"""

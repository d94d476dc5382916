"""What this machine does: figures for the README, made by `make bench`. Nothing here is a test.

kernels  real-time factor of the pendulum over event-time error, per method; ratio to C twins and to scipy
whole    the whole `rig simulate pendulum`, and its start from a new process
loop     the paced loop over the bus: round trip, ages, losses
"""

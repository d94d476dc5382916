"""Benchmarks of this machine for docs/benchmarks.md, run by `make bench`. They are not tests.

kernels        real-time factor of the pendulum over event-time error, per method; ratio to scipy
twins          kernels against their C twins: quiet tick, fixed step, the exact run of a stiff shunt, a film of points
(film)
absent_effect  cost of an absent effect
whole_runs     the whole `rig simulate` of the pendulum and of a squealing brake, and the start of a new process
disc           the slider on a flexible disc with seven modes: real-time factor over the error of its growth rate
one_contact    rigs of one contact: real-time factor
maps           a map of 100 x 100 points: its time, and the gain by a second core
loop           the paced loop over the bus: round trip, ages, losses
pages          pictures per second, their delay and the timing verdict of a run that eleven pages of rig web watch
against        the speed of this version over that of another (one_version runs one of them)
"""

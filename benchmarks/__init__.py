"""Benchmarks of this machine for docs/benchmarks.md, run by `make bench`; not part of the package `rig`, and not tests.

cases          every figure with a limit, in groups that are measured together
kernels        real-time factor of the pendulum over event-time error, per method; ratio to scipy
twins          kernels against their C twins: quiet tick, fixed step, exact, a film of points; a whole run in open loop
absent         the cost of an absent effect
whole_runs     the whole `rig simulate` of the pendulum and of a squealing brake, the start of processes
one_contact    rigs of one contact, the slider on a flexible disc, a map on two cores, an environment of Gymnasium
robust         a robust design, how long it takes
studies        points per second, the gain by a second worker
loop           the paced loop over the bus: round trip, ages, losses
recording      the cost of recording at high rates
pages          pictures per second, their delay and the timing verdict of a run that eleven pages of rig web watch
against        the speed of this version over that of another (one_version runs one of them)
holdout        `python -m benchmarks.holdout`: recommended settings of `rig cost` on randomly drawn rigs
"""

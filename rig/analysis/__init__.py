"""Analyses of a rig: equilibria, vibration modes, limit cycles, maps and recorded channels.

modes               eigenvalues about steady sliding; modes_report: as records, text and JSON
axis, sweep         a parameter at evenly spaced values; eigenvalues and critical values over it (sweep_figure)
eigenvalue_curves   eigenvalues followed along a parameter; critical_values, growth_crossings: where growth is zero
regions             stable and unstable regions over two parameters
control_loop        eigenvalues and margins of a closed loop (rig.design.sampled)
averaged            friction under dither, averaged over a period; forced: the motion under dither that is not fast
cycle               the limit cycle: orbit steps the plant, shooting and repetition find the cycle, floquet computes its
                    multipliers, turning_points serve vibration without events, cycle_report prints the result
map                 steady-state behaviour over one or two parameters
three_stages        the speeds at which stick ends and begins: accelerate, hold, decelerate
amplitude           the amplitude index of a measured vibration; upper_speed: the highest speed of stick-slip
identify            parameters of the lever rig from simulated experiments
recorded, sound     spectra, orders, hysteresis, pressure; the sound at a microphone
report              a recording as one page (HTML) that is self-contained
repeat              one scene simulated with many seeds
pool                many independent units of work in worker processes, with results in a folder
studies             a scene over parameters, with measures: grids, samples, repeated runs
motion_measures     measures of the plant's motion with actuators held
kernel_shapes       the properties that a scene's kernels are compiled for, and the shapes compiled so far
"""

"""Analyses of a rig: equilibria, vibration modes, limit cycles, maps and recorded channels.

modes               eigenvalues about steady sliding; modes_report prints them
axis, sweep         a parameter at evenly spaced values; eigenvalues and critical values over it
eigenvalue_curves   eigenvalues followed along a parameter, and where a growth rate is zero
regions             stable and unstable regions over two parameters
control_loop        the rig as a linear plant, eigenvalues and margins of a closed loop
loop_report         that loop with delays and links; jump_linear computes its growth, loop_check simulates it
averaged            friction under dither, averaged over a period
cycle               the limit cycle, found by simulation or by shooting; orbit steps the plant; cycle_report prints it
floquet             multipliers of a periodic motion, and of the motion under dither that is not fast
map                 steady-state behaviour over one or two parameters
stick_speeds        the speeds at which stick ends and begins
identification      parameters of a rig from recordings, with intervals and verdicts
recorded            spectra, orders, hysteresis, pressure, sound of a recording
report              a recording as one page (HTML) that is self-contained, of report_sections and page_elements
pool                a function over many items in worker processes, with results in a folder
studies             a scene over parameters, with measures: grids, samples, repeated runs
motion_measures     measures of the plant's motion with actuators held
kernel_shapes       the properties that a scene's kernels are compiled for, and the shapes compiled so far
figures             figures of cycle, sweep, modes, loop and repeated runs
"""

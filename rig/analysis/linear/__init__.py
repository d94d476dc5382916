"""What small vibrations do: a rig linearised about steady sliding, open or with a control loop closed.

modes               eigenvalues about steady sliding; modes_report prints them, mode_shapes draws them on a structure
eigenvalue_curves   eigenvalues followed along a parameter, and where a growth rate is zero
sweep               eigenvalues and critical values over one parameter
regions             stable and unstable regions over two parameters
control_loop        the rig as a linear plant, eigenvalues and margins of a closed loop
loop_report         that loop with delays and links; jump_linear computes its growth, loop_check simulates it
figures             figures of modes, sweep and loop
"""

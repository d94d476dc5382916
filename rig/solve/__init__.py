"""Compiled code: everything that runs in every tick of a rig. It reads tables (rig.model) and knows no particular rig.

records                what a kernel works on: state, scratch, log, plan; codes of contact states
advance                the loop that advances a state through ticks with the chosen method
frames                 plant, instruments (sampling) and controllers (control_loop) in one loop
exact, many_states     exact propagation: quiet ticks, ticks that are subdivided, cells of stiff mode sets
dopri5, rk4            Runge-Kutta methods; runge_kutta_stage is their common stage
rosenbrock             implicit steps in place of those of dopri5, with the exact Jacobian
collocation            steps of dopri5 in stiff mode sets, with exact propagators
film_steps             symplectic steps for a film of points that open and close all the time
contact_state          the contact state that agrees with the equations at an instant
forces                 right-hand side of a mode set: friction coefficients, products, random inputs
energy_balance         each term of the energy balance
expm, roots            propagators and responses of poles; the first zero crossing of a guard
places                 state, inputs, powers and outputs at eight places at once
column_blocks          sums in a fixed order, eight numbers at once
segment_output         outputs of a frame as piecewise polynomials
specialised            hot code compiled for a fixed number of states and called by address
"""

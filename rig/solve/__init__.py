"""Compiled code: everything that runs in every tick of a rig. It reads tables (rig.model) and knows no particular rig.

records                      what a kernel works on: state, scratch, log, plan
advance                      the loop that advances a state through ticks with the chosen method
frames                       plant, instruments (sampling, pole_response) and controllers (control_loop) in one loop
exact, many_states           exact propagation: quiet ticks, and the ticks that are subdivided
stiff_cells                  the same for mode sets in which some states decay within a tiny part of a tick
dopri5, rk4                  Runge-Kutta methods; runge_kutta_stage is their common stage, dense_output the quartic
                             between two steps
collocation                  steps of dopri5 in mode sets with such states, with exact propagators
kick, film_steps             symplectic steps for contacts that open and close all the time, and for a film of points
contact_state, state_codes   the contact state that agrees with the equations at an instant, and its codes
forces                       right-hand side of a mode set; friction_coefficient, product_inputs, random_input
energy_balance               each term of the energy balance
expm, exponential, roots     propagators, the exponential function, the first zero crossing of a guard
places, lanes                state, inputs, powers and outputs at eight places at once
column_blocks, rows          sums in a fixed order
segments, segment_output     outputs of a frame as piecewise polynomials
specialised                  hot code compiled for a fixed number of states and called by address
"""

"""What a motion does that has settled: it rests, repeats, or neither.

return_map        the motion over one period with exact events, its derivatives, and Newton's method on it
repetition        when a motion repeats: its period in the changes of its mode set
cycle             the limit cycle, simulated until it repeats, then closed; cycle_report prints it, figures draws it
averaged          friction under dither, averaged over a period
floquet           growth of a small disturbance of a periodic motion, and of the motion under dither that is not fast
motion_measures   measures of a motion from its start with actuators held, and the differences between two runs
"""

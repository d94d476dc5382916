"""The stability report before a run: eigenvalues of every mode set, growth, jamming, step limits.

report              the stability report of a rig: its findings with severity and remedy
examined_mode_sets  the mode sets that it examines
step_limits         whether a method can follow the rig at this step and tolerance
linearisation       steady sliding and its eigenvalues, from the same matrices as the run
jacobian            the linearised equations of a mode set at a state
growth              the limit of a growth: an event, a limiter, or none
"""

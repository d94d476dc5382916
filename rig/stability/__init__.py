"""What is known before a run: eigenvalues of every mode set, growth, jamming, step limits.

report         the stability report of a rig: its findings with severity and remedy
linearisation  steady sliding and the linearised equations about it, from the same matrices as the run
growth         what limits a growing motion
"""

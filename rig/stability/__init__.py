"""The stability report before a run: eigenvalues of every mode set, growth, jamming, step limits.

report         its findings with severity and remedy: what limits a growth, whether a method can follow the rig at this
               step and tolerance, in the mode sets that are examined
linearisation  steady sliding, its Jacobian and eigenvalues, from the same matrices as the run
"""

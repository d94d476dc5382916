"""What is known before a run: eigenvalues of every mode set, growth, jamming, step limits.

report         the stability report of a rig: what it finds, and what a run does about it
linearisation  steady sliding and the small motions about it, from the same matrices as the run
growth         what bounds a motion that grows by itself
"""

"""What all laws from formulas share.

compiled  formulas and numbers of a law as C functions for the kernels
checks    what is wrong with a law from elsewhere
"""

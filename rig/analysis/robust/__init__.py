"""Robust design: controllers, shunts and rigs designed against what is not known of the rig.

stated   ranges, tolerances and distributions as a user states them, read and checked
box      free values of a design and uncertain ones of a rig, both as unit cubes
growth   matrix, eigenvalues, gradients and growth of a rig of the box
limits   linear limits of a design
polish   a design improved against a set of rigs: linear programs over eigenvalues
ascent   from a rig to a worse one
worst    the worst rig of a design
tasks    the units of work that a pool computes
design   the robust design, the nominal optimum, the audit
"""

"""Analyses of a rig, one room for each question. Each room imports only from those below it.

report           what a recording shows, as one page
identification   parameters of a rig from recordings, with intervals and verdicts
map, studies     what a rig does over many values: steady motion; grids, samples, repeated runs, searches
recorded         what a recording tells: spectra, orders, hysteresis, pressure, sound, sticking
branches         every steady motion over a parameter: sliding, cycles, their stability and where they change
linear           what small vibrations do: modes, sweeps, regions, control loops
cycles           what a settled motion does: return map, limit cycle, Floquet exponents
pool             many computations in several processes, and the kernels that they need
"""

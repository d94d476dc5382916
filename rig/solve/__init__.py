"""Time integration of linear structures with frictional contacts. Knows modes, guards and matrices; knows no rig.

assembly     rows by name: what plants and effects write
formulation  the matrices of one mode set
singular     why a mode set has none
tables       what a kernel reads, stacked by mode set
mode sets        the mode sets a run has visited, built when they are met
signals      what sensors read, as rows over the state
expm         propagators
roots        the first fall of a polynomial through zero
laws         friction coefficient over slip speed
settle       the modes that agree with the equations at one instant
records      what a kernel works on: state, scratch, log, plan
carry        the compiled loop that hands the state from method to method
frames       plant, instruments (sampling, response) and controllers (control) in one compiled loop
leaf         hot code for a number of states, called by address
plan, parts  which compiled code a rig needs, and where it begins
exact        propagators per tick, guards certified, uncertified ticks opened
dopri5, rk4  for laws that fall with speed, and for comparison
kick         for contacts that open and close all the time
film         contacts that travel, stick and slip each by itself: what they are
riding, ride their tables, and the steps of kick with them
smooth       friction without rest, to be seen failing
energy balance       energy, each term integrated on its own
method       which of them carries a system on
motion       the run: one state, its time and its modes
verdict      what eigenvalues say before the run starts
segments     the signals of one frame, for the sensors
"""

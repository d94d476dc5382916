"""One file, one physical effect. An effect that the scene does not name is not there: no state, no row, no branch.

friction   the laws: Coulomb, constant, Stribeck, linear falling, exponential, tabulated, seal
drive      speed of the belt or disc; its lag and its limits
load       the normal force; lag and limits of the magnet that holds it
sector     a part of the disc with a friction of its own
inhomogeneity  a structure that is stiffer or softer with the turn of the disc
tuned_mass a tilted absorber on the body; its inertia enters the normal force
dither     a fast vibration of the belt, of the mass or of the normal force
separation  a contact spring that lifts off and comes back
disc_modes  the free vibration of a flexible disc; of the brake, in place of its rigid one
moving_contact  what a contact changes that moves over a flexible disc: geometry, slope
piezo, stack  a linear piezo stack in the load path
shunt, shunt_limits  the electrical network on it: resonant, with negative capacitance, switched
amplifier  a commanded voltage on it
noise      a random force along the sliding direction

Each file declares its parameters (a `Section`, with units) and adds its rows to a `rig.model.assembly.Assembly`.
"""

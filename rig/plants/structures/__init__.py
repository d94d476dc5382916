"""Structures that plants use: beams, rigid bodies, plates of finite elements.

bending         modes of a clamped beam
same_modes      refuses values in a run that would change the modes
series          power series of two small angles
multibody       bodies on springs: rigid ones, and the bending disc of the brake
hexahedra       finite elements of solids
plate_elements  plate and foam of finite elements
plate_model     the plate, reduced to its modes; plate_surface: shapes of the plate at its top face
film_slider     a rigid slider on a film over a plate, and the points of this film
structure_tables  the tables of a structure of the user's own; structure_model: its full and its reduced matrices
"""

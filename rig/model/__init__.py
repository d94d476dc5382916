"""A rig in matrices: rows by name, then matrices, mode sets and tables. numpy, built once per scene.

assembly             a rig as plants and effects state it: rows by name (named_rows), outputs, inputs
matrices             from rows by name to a system
system               the same rig as matrices, contacts, network and limiters; findings before it runs
products             products of states and forces
formulation          the matrices of one mode set, outputs as rows over the state; `singular`: why a mode set has none
friction_law         friction laws
method               which integration method serves a rig, and the system as this method sees it
mode_sets            the mode sets that a run has visited, each built at the first visit
tables               what compiled code reads of all mode sets; parts of it are energy_forms, film_tables and
                     many_states_tables
workspace            the scratch memory of compiled code
film                 a film of contact points under a slider that travels
row_checks           checks of rows with a foreign plant or effect
"""

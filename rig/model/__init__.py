"""A rig in matrices: rows by name, then matrices, mode sets and tables. numpy, built once per scene.

assembly             a rig as plants and effects state it: rows by name (named_rows), outputs, inputs
matrices, system     the same rig as matrices, contacts, network, limiters and products (system_parts)
formulation          the matrices of one mode set; `singular` says why a mode set has none
friction_law         friction laws; product_terms: products of states, forces and angles
output_rows          outputs as rows over the state
method, smooth       which integration method serves a rig, and the system as this method sees it
mode_sets            the mode sets that a run has visited, each built at the first visit
tables               what compiled code reads of all mode sets; its parts are energy_forms, kick_tables,
                     many_states_tables (with economisation) and film_tables
film                 a film of contact points under a slider that travels; film_system: a system with it
workspace            scratch memory for compiled code
build_checks         checks that a rig requests before a run
"""

"""A user's own structure: matrices of a finite element program, contacts between its nodes, and their reduction.

    M x'' + D x' + K x = sum_c (n_c N_c + t_c T_c) + loads          n_c, t_c: rows of the contact points (Points)

Full matrices are sums of parts that a scene scales (Full); a reduced model is what a rig is made of.

full         parts, rows of contacts and nodes
mesh         nodes, node sets and outer faces
matrix_files matrices from files of finite element programs
read         the parts of a structure, checked, in SI units
faces        surfaces of triangles, and where lines along normals meet them
contacts     the points of contacts between node sets
rows         rows of rigid motions, of nodes, and of contacts from a file
eigenvalues  modes and complex eigenvalues, complete within a range
estimate     the error of reduced eigenvalues; what more contact points would change
snapshots    bases that are trained over ranges of numbers
basis        modes and attachment vectors; the reduced model of a scene, from the store or built
reduced      the reduced model
model_store  reduced models, stored on disk and in recordings
"""

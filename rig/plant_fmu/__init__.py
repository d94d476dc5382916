"""A scene as an FMU for co-simulation (FMI 2.0): the plant with its sensors, driven by another program.

export        writes the FMU: scene, the model description (inputs, outputs, units), and the compiled shim
shim.c        the functions of FMI, which talk to a child process
child         the child process, which runs the rig

The FMU contains no Python. The program that imports it needs a Python with this package, whose path is a parameter.
"""

"""From a physical quantity to samples: the base class of all instruments, and the object that runs them.

instrument  base class of all instruments     front_end  the common description of all instruments
filters     transfer functions, modal form    streams    random numbers, drawn in advance
bank        all instruments of a scene        instants   the sample instants
units       types of quantities that only instruments have
"""

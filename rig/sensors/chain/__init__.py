"""From a physical quantity to samples: what all instruments declare, and what runs them.

instrument  what all instruments declare      front_end  the one description each compiles to
filters     transfer functions, modal form    streams    random numbers, drawn ahead
bank        all instruments of a scene        instants   when samples are taken
units       quantities that only instruments have
"""

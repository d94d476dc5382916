"""Building blocks of controllers.

base       the protocol of controllers; change of parameters during a run
design     the design step and the linear form of a controller
velocity   the velocity for a feedback: measured or observed, filtered, predicted
observer   a Kalman observer as plain arithmetic
resonator  a narrow band of a signal: amplitude, phase, frequency
feedback   feedback of a velocity to one actuator
system_file, discretise   a linear system from a file, and at the period of its controller
"""

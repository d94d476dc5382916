"""What controllers are built from.

base       what a controller is; change of parameters while it works
velocity   the velocity fed back: measured or observed, filtered, predicted
observer   a Kalman observer as plain arithmetic
resonator  a narrow band of a signal: amplitude, phase, frequency
feedback   feedback of a velocity to one actuator
"""

"""Measures of a plant's motion from its start with actuators held: period, amplitude, stick share, frequency, growth.

settings   the method of integration with its step or tolerance
problem    plant, start and duration, and the kind of motion: a cycle, a vibration, a smooth motion
measures   the measures of a run, and the differences between two runs
"""

"""What runs a controller.

loop       a controller at work: state, command in force, values that are no numbers
process    a process of its own
service    its events and parameters on the bus
file       a user's own controller from a file
native     a controller whose `update` is compiled: `translate` and `body` turn it into text for a compiler
"""

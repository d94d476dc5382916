"""The code that runs controllers.

loop       a controller in operation: state, command in force, handling of values that are not finite
process    a controller in its own process
service    events and parameters of a controller on the bus
file       a user's own controller from a file
native     a controller whose control law is compiled
stand_in   a stand-in for a board, with the law of a shipped controller
"""

"""The machine: processes, processors, files that others can reach.

process     what every process of this project does at its begin and end, and child processes
scheduling  where processes run, their time slices, locked memory
files       files that a user names, locks, and caches that only their owner can have written
"""

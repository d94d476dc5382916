"""What compiled code needs.

kernel        the one decorator for compiled code, with a cache that never runs outdated physics
kernel_store  compiled kernels in the user's cache, under the hash of their sources
records       records lent to kernels, and memory that stays where it is while they use it
"""

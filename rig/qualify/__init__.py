"""What one learns of the simulator itself.

cost              what accuracy costs in time: error against compute time, per method and step
torture           hard cases by methods by steps, each with a test result
effects_measured  what each effect of a scene costs and changes; effects_figure draws it
frame_costs       what the frames of a scene cost
doctor            what this machine can carry; round_trip: what the bus costs here
warmup            compiles the kernels of the shipped scenes
benchmarks        the figures of `make bench`
"""

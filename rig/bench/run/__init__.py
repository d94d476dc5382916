"""One run of a rig: what happens at a tick is the same in every mode.

runner                plant and sensors of a scene, stepped frame by frame
heard_over_links      what controllers receive of the sensors over impaired links; faulty_sensors: broken sensors
plant_truth           what it collects: outputs at every step, mode sets, events; measurements: those of all sensors
experiment            everything that happens at a tick between measurement and integration
protocol              the steps of an experiment, due at ticks or after a condition; actions: what it asks for
exchange              commands: taken over, held, clamped, refused, replaced by safe values, or played from a recording
command_queue         the commands of one controller
local_controllers     controllers that work in this process: called from Python, or lent to the compiled loop
rig_variants          the same rig with other parameters
builds                a new matrix takes time: rigs are built beside the frames, and who waits for them
before                findings before a run
journal               the events of a run
audit                 which effects changed nothing in it, and which were missing
rig_comparison        the rigs of a run and others at the same states; driving_history: what drove the rig
checkpoint            the state of plant and instruments, kept in the recording
simulate              a run in this process, as fast as possible; a rig that begins again, for agents
"""

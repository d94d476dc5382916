"""The bench runs a rig, alone or with other processes.

runner                plant and sensors of a scene, frame by frame; depends on ticks only
protocol              the steps of an experiment, due on ticks
experiment            what happens at a tick between measurement and integration, the same in every mode
exchange              commands: taken over, held, clamped, refused, replaced by safe values; command_queue holds those
                      of one controller, playback those of a recording
tuning                values that an operator or the protocol changes while the rig runs
rig_variant           the same rig with other parameters; background_builds, rebuild, prepared_rigs, postponed_steps
                      build it beside the frames
simulate              everything in one process, as fast as possible
controller_in_process a controller that works in this process; compiled_controllers: within the compiled loop;
                      controllers_in_plant: in the plant's process of a live run
plant                 the plant of a live run, in lockstep or paced; plant_parts: hub, operator_commands, housekeeping
plant_process         its process; finalise: the end of a run
frame_batches         how many frames are carried at once
pace, timing          the wall clock, and the timing verdict
supervise             the processes of one run
status                the status line and the summary of a run
replay, verify        a recording on the bus again, and simulated again; chaotic_runs compares two processors
"""

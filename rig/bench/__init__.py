"""The bench runs a rig, in one process or with other processes.

runner                plant and sensors of a scene; the result depends on ticks only. stepped_plant: steps them frame by
                      frame; commanded_plant: puts commands into force at a tick
protocol              the steps of an experiment, due at ticks (actions, wait_condition)
experiment            everything that happens at a tick between measurement and integration, the same in every mode;
                      outside_actions: knocks, controllers that are connected, admitted, dismissed
exchange              commands: taken over, held, clamped, refused, replaced by safe values; command_queue: commands of
                      one controller; playback: commands of a recording
tuning                values that an operator or the protocol changes while the rig runs
rig_variant           the same rig with other parameters; rig_variants, background_builds, rebuild, prepared_rigs and
                      postponed_steps build it while frames go on
simulate              runs everything in one process, as fast as possible
controller_in_process a controller that works in this process; compiled_controllers: in the compiled loop;
                      controllers_in_plant: in the plant process of a live run
plant                 the plant of a live run, paced or in lockstep; plant_parts: its parts, among them hub (with
                      sample_blocks and command_inbox), operator_commands, housekeeping
plant_process         the process of this plant; finalise: the end of a run
rehearsal             simulates the protocol before a paced run, so that nothing is compiled or built during it
frame_batches         the number of frames that are computed in one piece
pace, timing          the pace of the wall clock; the timing verdict
supervise             starts and ends the processes of one run; job: what the plant is to do; outcome: the result
status                the progress line and the summary of a run; journal: its events; audit: its effects, with
                      driving_states: what drove the rig
replay, verify        plays a recording back on the bus; simulates it again; chaotic_runs compares two processors
"""

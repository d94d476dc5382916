"""A live run: the plant process with its pace, its connection to the bus, its supervisor.

supervise             starts, observes and ends the processes of one run; outcome: its job and its result
plant_process         the process of the plant
plant                 the plant of a live run, paced or in lockstep, from its parts to its summary
hub                   publishes what happens; sample_blocks: samples in blocks; command_inbox: commands received
asked_controllers     controllers that the plant asks: in its process, in lockstep in others
operator_commands     what other processes can do to a running plant
housekeeping          presence, health, skipped time; a plant without a pace waits for its recorders
pace, timing          the pace of the wall clock; lateness, and the timing verdict
machine_load          what else kept the processors busy
rehearsal             simulates the protocol before a paced run, so that nothing is compiled or built during it
status                progress line and summary
"""

"""The bench: whatever lets a rig run, alone or with others.

stand           the plant and its instruments, frame by frame; depends on ticks only
protocol        the steps of an experiment, due on ticks
exchange        commands: taken over, held, clamped, refused, replaced by safe values; playback: those of a recording
operation       what happens at a tick between measurement and integration; the same in every mode
tuning          values that an operator or the protocol changes while the rig runs
variant, builds, refit, upcoming   other rigs that it goes on as, built beside the frames
simulate        everything in one process
working         a controller that works in this process; inside: within the compiled loop; in_plant: in a live run
plant_process   the plant as a process: lockstep or paced; hub, desk, attend and conclude are its parts
pieces          how many frames are carried at once
pace, timing    the pace of the wall clock, and how well it was kept
supervise       the processes of one run, from start to end
status          the line during a run and the summary after it
replay, verify  a recording on the bus once more, and simulated once more; chaotic: how far two processors agree
"""

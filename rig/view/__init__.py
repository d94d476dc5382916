"""Views of a run: the live view in rerun, and the figure of a run.

process           the viewer's process: receives messages from the bus, collects them in batches, sends them to rerun
drawing           the entities of a run in rerun, and its phase portrait
blueprint         the arrangement of the rerun window
viewer            starts rerun's viewer, or writes a file; recording: a recording in rerun
picture           selects the moving picture of a rig; base: common to all of them
belt, pendulum    pictures of single rigs, as are beam, brake, four_dof, lever, plate and surfaces
run_figure        the figure of a run
curves            curves over time, phases, marks, and the text beside them, in all figures of runs
channels          which output and which sensor belongs to which plot
contact           contact states as words and colours
pressure          the pressure of a film: colours, maps, the figure of a run of the plate rig
palette           colours; a figure written to its file, completely or not at all
"""

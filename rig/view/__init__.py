"""Views of a run: the live view in rerun, and the figure of a run.

process           the viewer's process: receives messages from the bus and sends them to rerun
feed              collects messages and converts them to columns, in batches
drawing           the entities of a run in rerun
blueprint         the arrangement of the rerun window
viewer            starts rerun's viewer, or writes a file
picture           selects the moving picture of a rig; each picture has a module; base, shapes: common to all pictures
phase_portrait    the phase portrait of the live view
run_figure        the figure of a run; plate_figure: that of the plate rig
curves, caption   curves over time, and the text beside them, in all figures of runs
timeline          phases of the protocol, marks, and when each controller worked
channels          which output and which sensor belongs to which plot
contact           contact states as words and colours
pressure_colours  colours of the pressure of a film; pressure_maps: its maps in figures
save_figure       writes a figure to its file, completely or not at all
"""

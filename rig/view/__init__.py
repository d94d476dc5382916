"""Views of a run: the live view in rerun, and the figure of a run.

process           the viewer's process: receives messages from the bus and sends them to rerun
feed              collects messages and makes batches of rows; spans: extremes in spans of time
drawing           the entities of a run in rerun; portrait: its phase portrait
blueprint         the arrangement of the rerun window
viewer            starts rerun's viewer, or writes a file; recording: a recording in rerun
picture           selects the moving picture of a rig; base: common to all of them
belt, pendulum    pictures of single rigs, as are beam, brake, four_dof, lever, plate and surfaces
run_figure        the figure of a run; friction_figure: the friction laws of a scene
curves            curves over time, phases and marks in all figures of runs; header: the text around them
channels          which output and which sensor belongs to which plot
contact           contact states as words and colours
pressure          the pressure of contact points: colours and maps; pressure_figure: the figure of a run with them
palette           colours; a figure written to its file, completely or not at all
"""

"""What one sees of a run: the figure of a run, and rerun, live or from a recording.

figure      a run as one PNG                       contact     contact modes as words and colours
story       phases, marks, controllers at work     channels    which signal belongs to which plot
process     the bridge: bus -> rerun               log         a recording in rerun
stream      messages -> columns, in batches        picture     the rig as a moving picture
blueprint   the arrangement of the window          viewer      the viewer's own process
put         a figure into its file, whole or not        plate       the plate rig: picture, map of its pressure
heat, maps  colours of pressure; maps in figures        plate_figure  the figure of its runs
curves      curves over time, of all figures
"""

"""Parameters of a rig from recordings, with intervals that hold and a verdict for each.

runs        the file that lists the recordings, and what is free
responses   what the rig does at values of its parameters, computed in the pool
cycles      measured cycles, their measures, and what a model leaves of them
fit         least squares, and the covariance clustered by cycle
identify    the way from start to answer
twins       simulated runs, which tell what process noise does to a fit
influence   what the data cannot tell apart, and which fixed value would help
answer      value, interval and verdict; the report

Methods: multiple shooting on cycles with free shifts; sandwich covariance, White, Econometrica 50 (1982) 1; Hotelling's
test of the mean residual; block bootstrap, Kuensch, Annals of Statistics 17 (1989) 1217.
"""

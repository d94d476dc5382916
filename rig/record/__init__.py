"""Recordings: MCAP files that contain their schemas, their scene and their provenance.

rig.record.reader.open(path) -> Run                a recording as arrays; reads truncated files up to the break
rig.record.message_scan.Scan(path)                 its messages and what damage there is, proved by checksums
rig.record.recorded_setup.setup_of(scan)           the description of its run
rig.record.save_run.save(run, path)                write a Run of this process as a file
rig.record.export                                  a recording for other programs: CSV, MATLAB, netCDF, ...
rig.record.recorder.record(...)                    the recorder process of a live run; sender_lives: lost messages
rig.record.recover.recover(path)                   make a clean file from a truncated one
rig.record.replay.replay(session, path)            publish a recording again, for viewers and controllers
rig.record.rebuilt_traffic.RebuiltTraffic(run, ..) the messages of a Run, as plant and controllers publish them
rig.record.compare.compare(a, b)                   the first and largest differences between two runs
rig.record.run_list.drives(run)                    the outputs that are the speed of a drive; portrait_pair(run)
rig.record.film_points.points_of(scene)            the points of a film: places, outputs with their pressure
rig.record.statistics.statistics(run)              RMS, bands, share of contact; first_opening(run)
rig.record.recorded_setup.models(attachments)      reduced models of structures in a recording
rig.record.statistics.characteristic(run)          characteristic instants of the pressure of a film
"""

"""Recordings: MCAP files that contain their schemas, their scene and their provenance.

rig.record.reader.open(path) -> Run                a recording as arrays; reads truncated files up to the break
rig.record.save_run.save(run, path)                write a Run of this process as a file
rig.record.recorder.record(...)                    the recorder process of a live run
rig.record.recover.recover(path)                   make a clean file from a truncated one
rig.record.replay.replay(session, path)            publish the recorded measurements again, for a controller
rig.record.compare.compare(a, b)                   the first differences between two runs, bit by bit
rig.record.film_points.points_of(scene)            the points of a film: places, outputs with their pressure
rig.record.statistics.statistics(run)              RMS, bands, share of contact; first_opening(run)
rig.record.model_attachments.models(attachments)   reduced models of structures in a recording
rig.record.pressure_instants.telling(run)          characteristic instants of the pressure of a film
"""

"""Recordings: MCAP files that carry their schemas, their scene and where they come from.

rig.record.reader.open(path) -> Run          what happened, as arrays; reads truncated files up to the break
rig.record.save_run.save(run, path)                a Run of this process as a file
rig.record.recorder.record(...)                    the recorder process of a live run
rig.record.recover.recover(path)                   a clean file from a truncated one
rig.record.replay.replay(session, path)            the sensor traffic once more, into a controller
rig.record.compare.compare(a, b)                   where two runs part, to the bit
rig.record.film_points.points_of(scene)            the points of a film: places, outputs with their pressure
rig.record.statistics.statistics(run)              RMS, bands, share of contact; first_opening(run)
rig.record.model_attachments.models(attachments)   reduced models of structures in a recording
rig.record.pressure_instants.telling(run)          instants at which that pressure tells most
"""

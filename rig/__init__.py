"""friction-rig: a laboratory in software for friction-induced vibration.

solve     time integration: modes, guards, event location
effects   one file, one physical effect
plants    what stands on the bench
scenes    a plant, its effects, sensors, controllers and protocol, as TOML
bus       how processes talk
bench     the loop: in-process, lockstep, paced
record    MCAP: write, read, recover, replay, compare
view      rerun, live; figures
study     what one learns from a rig
"""

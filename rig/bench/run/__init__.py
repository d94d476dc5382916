"""One run of a rig: plant runner, exchange, protocol, controllers in this process, journal and audit."""

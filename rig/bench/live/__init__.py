"""A live run: plant, hub, pace and processes."""

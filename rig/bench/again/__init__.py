"""A recording again: branched, played back, replayed, verified."""

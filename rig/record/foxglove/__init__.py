"""The type of log messages that Foxglove, Lichtblick and rerun show: `Log.proto`, and what `make proto` makes of it."""

"""The machine: processes, processors, files that others can reach."""

"""Pictures of a run, a replay and a cross-check."""

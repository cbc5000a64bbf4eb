"""The closed loop: its parts, how a scenario sets them up, and what a run leaves."""

"""Control laws as a scenario sets them up, and the drives that carry them out."""

"""Pictures of a cross-check, of one body and of several agents."""

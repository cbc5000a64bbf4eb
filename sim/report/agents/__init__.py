"""Pictures of several agents."""

"""The plants: MJCF, its compilation, and parameters with their provenance."""

"""Pictures of what is made of a flight log."""

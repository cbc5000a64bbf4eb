"""What agents hear of each other."""

"""What the cross-check knows of each kind of plant."""

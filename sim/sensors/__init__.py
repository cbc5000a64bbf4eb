"""What the sensors say of the truth."""

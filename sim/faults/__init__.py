"""What goes wrong, when and with what."""

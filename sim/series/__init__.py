"""Time series of recordings as pictures and recordings show them."""

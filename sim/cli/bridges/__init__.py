"""Commands that hand what the twin knows to other tools."""

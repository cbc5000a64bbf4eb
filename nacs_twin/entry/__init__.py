"""The command, which is begun here."""

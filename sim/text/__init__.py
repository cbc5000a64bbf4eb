"""Text that people write and read: names, one line of complaint, tables at a terminal, TOML."""

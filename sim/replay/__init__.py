"""Flight logs, and filters run over them."""

"""What is loaded before anything else of the twin: whether the packages that it is about to import are its own, and its command."""

"""Other people's software, each in a virtual environment and a process of its own."""

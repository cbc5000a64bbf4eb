"""Cost of the twin, alone and beside other people's software: `make bench`."""

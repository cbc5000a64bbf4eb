"""The testbed's disturbance from the paper's printed tables: a design of flights, an emulator of them, and the posterior of the causes."""

"""The plant with its sensors as a functional mock-up unit (FMU), for other simulators."""

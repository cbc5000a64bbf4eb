"""Linear models of a plant about an operating point, and the stability margins of its control laws."""

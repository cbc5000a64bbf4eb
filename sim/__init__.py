"""The twin at work: plant, sensors, faults, references, the loop, scenarios, metrics, recordings, report and command line."""

"""What goes wrong is one line that says what, where, and what would be right."""

import nacs

for attempt in ({"run.tiks": 10}, {"plant.mass_kg": -1.0}, {"control.feedback": "no-such-filter"}):
    try:
        nacs.run("nacs/fault-free", set=attempt)
    except nacs.NacsError as wrong:
        print(wrong)
